"""What the verdict says of residuals that noise of the sensor may have left: noise that is correlated."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.problem.correlated.limits import by_chance, enough
from plantfit.trust.verdict.estimators.filtered import named
from plantfit.trust.verdict.estimators.lengths import compared, times
from plantfit.trust.verdict.outputs import Findings, Row, diagnosed, disagree
from plantfit.trust.verdict.unseen import failing
from plantfit.trust.verdict.words import Sentence, estimate, number, say, some

SHORTER = 0.9  # of an interval's length, from which on it is worth a sentence
BEST = 3  # parameters that it lists


def may_be_noise(findings: Findings, output: str) -> bool:
    """Whether noise that is correlated explains what is left of an output: it leaves nothing of the correlation, and
    least squares weighted for it, which could have moved the parameters, does not; and no addition to the model, no
    unseen samples and no recording against another shows a fault. A drift alone would pass the first two."""
    found = findings.get("correlated")
    if not found or found["differs"] or found["p"] is None:
        return False
    asked = diagnosed(findings)
    looked = asked["tried"] or found.get("least_squares")  # else whoever asks for such weights says that it is noise
    if not looked or asked["named"] or _unknown(findings) or disagree(findings) or output in failing(findings):
        return False
    noise = next((n for n in found["noise"] if n["output"] == output), None)
    if noise is None or not (noise["order"] or noise["form"]):
        return False
    return enough(noise["independent"], noise["samples"]) and by_chance(noise["left"], noise["samples"])


def as_noise(findings: Findings) -> str:
    """That noise may have left it."""
    return (
        "Noise that is correlated would leave the same: weighted for it, the parameters stay where they are "
        f"(p = {findings['correlated']['p']:.2g})"
    )


def weighted_sentences(findings: Findings, coloured: Sequence[str]) -> Iterator[Sentence]:
    """What least squares weighted for the noise of the `coloured` outputs says beside plain least squares: that not
    all is noise, or that it knows more."""
    found = findings.get("correlated")
    if found and found.get("least_squares"):
        yield from _taken(findings, found)
        return
    if why := findings.get("standard_errors", {}).get("not_weighted"):
        asked = named(findings["standard_errors"].get("estimator") or "generalised least squares")
        yield say("info", f"{asked[:1].upper()}{asked[1:]} was asked for and is not the answer: {why}.")
    if not coloured or diagnosed(findings)["named"]:
        return
    yield from _may_wander(findings)
    if not found:
        return
    least = {p["name"]: p for p in findings["parameters"]}
    if found["differs"] and all(enough(n["independent"], n["samples"]) for n in found["noise"]):
        [moved] = [p for p in found["parameters"] if p["name"] == found["moved"]]
        unit = f" {moved['unit']}" if moved["unit"] and moved["unit"] != "1" else ""
        text = (
            f"Not all that is left is noise: weighted for its correlation, {moved['name']} would be "
            f"{number(moved['value'], 4)}{unit} in place of {number(least[moved['name']]['value'], 4)} "
            f"(p = {found['p']:.2g}); the model lacks something that moves its parameters."
        )
        yield say("warning", text, p=found["p"])
        return
    if not all(may_be_noise(findings, output) for output in coloured):
        return
    ratios = [(p, ratio) for p in found["parameters"] if (ratio := _shorter(least.get(p["name"]), p)) is not None]
    better = sorted((r for r in ratios if r[1] <= SHORTER), key=lambda r: r[1])
    if better:
        listed = [_as_estimate(p) for p, _ in better[:BEST]]
        shown = some(listed) if len(better) <= BEST else f"{', '.join(listed)} and {len(better) - BEST} more"
        text = (
            f"If it is noise, generalised least squares knows more: {shown} "
            '(`plantfit estimate --method "generalised least squares"`).'
        )
        yield say("info", text, ratio=better[0][1])


def _may_wander(findings: Findings) -> Iterator[Sentence]:
    """That noise may move the plant, where nothing that was tried explains what is left and nobody asked for it."""
    errors, shared = findings.get("standard_errors") or {}, any(r.get("shared") for r in findings["residual_tests"])
    if errors.get("filterable") and not errors.get("estimator") and diagnosed(findings)["tried"] and not shared:
        text = (
            "Noise that moves the plant itself, as draughts and loads do, would leave such residuals too: estimator = "
            '"maximum likelihood" in the study file allows for it, and is not taken where it does not explain them.'
        )
        yield say("info", text)


def _taken(findings: Findings, found: Mapping[str, Any]) -> Iterator[Sentence]:
    """That the answer is that of generalised least squares, what it gains, and whether what is left is noise."""
    noisy = [n["output"] for n in found["noise"] if n["order"] or n["form"]]
    lengths = compared(found["least_squares"], {p["name"]: p for p in found["parameters"]})
    text = f"The parameters were estimated together with the noise of {some(noisy)} (generalised least squares)"
    text += f": {lengths[0]}" if lengths else ""
    yield say("info", f"{text}.", **({"ratio": lengths[1]} if lengths else {}))
    odd = diagnosed(findings)["named"] or disagree(findings) or any(o in failing(findings) for o in noisy)
    if odd:
        yield say(
            "warning",
            f"These intervals take what is left of {some(noisy)} for noise, and it is not noise alone: they may be too "
            'short; `estimator = "least squares"` gives those that allow for it.',
        )


def _unknown(findings: Findings) -> bool:
    """Whether residuals are too slow, or samples too few, for intervals that surely hold."""
    return not (findings.get("determined") or {}).get("sound", True)


def _shorter(least: Row | None, weighted: Mapping[str, Any]) -> float | None:
    """Length of the weighted interval over that of least squares, where both ends of both are known."""
    return None if least is None or least.get("status") != "determined" else times(least, weighted)


def _as_estimate(p: Mapping[str, Any]) -> str:
    return estimate({**p, "standard_error": (p["high"] - p["low"]) / (2 * 1.96)})


__all__ = ["as_noise", "may_be_noise", "weighted_sentences"]
