"""What the verdict says about inputs: of derivatives in the columns of a regression, of the steps or noise with which
they were read, and of how they go on between samples."""

from collections.abc import Iterator, Mapping
from typing import Any

from plantfit.recording.looks.look import MISREAD
from plantfit.trust.looks.misreadings import as_commanded, as_exact
from plantfit.trust.verdict.words import Sentence, interval, number, say, some, with_unit

SHOWN = 0.2  # share of the residuals' mean square from which on they are said to show the steps


def derivative_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence where columns of a regression are derivatives of measured signals: their errors draw least squares
    away from the truth, which residuals do not show."""
    names = findings.get("differentiated")
    if not names:
        return
    text = (
        f"The columns of this regression hold {some(names)}. Where these are derivatives of measured signals, their "
        "errors stand in the columns: least squares may be off by more than ± tells, and the residuals do not show it. "
        'Fit it by instrumental variables: [regression] method = "instrumental variables" (docs/regression.md).'
    )
    yield say("warning", text, signals=len(names))


def misreading_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence where steps of inputs widen intervals, with the inputs, their steps, and the parameter that they
    move most."""
    rows = [p for p in findings["parameters"] if p.get("by_steps") and p["standard_error"]]
    looks = [look for look in findings["data"] if look["kind"] in MISREAD]
    if not rows or not looks:
        return
    worst = max(rows, key=_times)
    decided = [p["name"] for p in rows if 2.0 * p["by_steps"] ** 2 > p["standard_error"] ** 2]
    kinds = {look["kind"] for look in looks}
    what = (
        {"counted": "counts", "noisy": "readings"}.get(min(kinds), "steps") if len(kinds) == 1 else "errors of readings"
    )
    most = (
        f"; {what} outweigh the noise in {len(decided)} of {len(rows)} parameters ({some(decided)})"
        if decided and len(rows) > 1
        else ""
    )
    text = (
        f"{_told(looks)} Intervals allow for it: that of {worst['name']} is {number(_times(worst))} "
        f"times as wide as by the noise, {interval(worst['low'], worst['high'], worst['unit'])}{most}. "
        f"{_seen(looks)}; only {_better(kinds)} narrow the interval."
    )
    for kind, else_, key in (
        ("rounded", "{} was commanded and not measured", as_commanded),
        ("noisy", "the plant got what is recorded", as_exact),
    ):
        guessed = [look for look in looks if look["kind"] == kind and not look["figures"]["told"]]
        if guessed:
            name, where = guessed[0]["signal"], guessed[0]["recording"]
            text += f" If {else_.format(name)}, write {key(name)} under [recording.{where}]."
    yield say("warning" if decided else "info", text, widening=_times(worst), outweighed=len(decided))


def hold_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence for every input whose hold nobody stated and a dead time rests on, or straight lines explain; the
    last of the latter has the line to write, which is one for all of them."""
    units = {p["name"]: p["unit"] for p in findings["parameters"]}
    looks = [look for look in findings["data"] if look["kind"] == "hold"]
    written = [look["signal"] for look in looks if look["write"]]
    for look in looks:
        u, name, figures = look["signal"], look["other"], look["figures"]
        held, straight = (
            "" if name is None else with_unit(figures[kind], units[name]) for kind in ("previous", "linear")
        )
        if look["write"]:
            before = written[: written.index(u)]
            beside, left = (f" beside those of {some(before)}", "then left") if before else ("", "left")
            explained = figures.get("explained") or 0.0  # which findings of earlier versions have not
            share = f"they explain {100 * explained:.2g} % of what is {left}" if explained > 0 else ""
            moved = f"{name} is then {straight}, and not {held}" if name is not None else ""
            gained = " and ".join(filter(None, (share, moved)))
            text = (
                f"{u} is held between its samples, as nobody said how it goes on, and straight lines fit better"
                f"{beside} ({number(figures['standard_errors'])} standard errors): {gained}."
            )
            if u == written[-1]:
                text += f" Write {look['write']} under [model]."
        else:
            text = (
                f"{name} rests on how {u} goes on between its samples, which the study does not say and the record "
                f"does not tell: {held} if {u} is held until the next sample, {straight} if it goes straight to it. "
                f'Write hold = {{ {u} = "previous" }} or hold = {{ {u} = "linear" }} under [model], whichever is right.'
            )
        values = {} if name is None else {"held": figures["previous"], "straight": figures["linear"]}
        yield say("warning", text, **values)


def _better(kinds: set[str]) -> str:
    finer = "finer counts" if kinds == {"counted"} else "finer steps"
    return finer if "noisy" not in kinds else "quieter readings" if len(kinds) == 1 else f"{finer} and quieter readings"


def _seen(looks: list[Mapping[str, Any]]) -> str:
    """Whether the residuals show the steps."""
    left = max(look["figures"]["left"] or 0.0 for look in looks)
    if left < SHOWN:
        return "Residuals hardly show this error"
    return f"About {100 * min(1.0, left):.0f} % of the mean square of the residuals may be this error"


def _times(p: Mapping[str, Any]) -> float:
    """How many times as wide the interval is as by the noise alone."""
    rest = max(p["standard_error"] ** 2 - p["by_steps"] ** 2, 1e-12 * p["standard_error"] ** 2)
    return p["standard_error"] / rest**0.5


def _told(looks: list[Mapping[str, Any]]) -> str:
    """Inputs by how they were read, the coarsest of each kind with its numbers."""
    parts = []
    for kind in MISREAD:
        own = [look for look in looks if look["kind"] == kind]
        if not own:
            continue
        names = some(list(dict.fromkeys(look["signal"] for look in own)))
        figures = min(own, key=lambda look: look["figures"]["steps"])["figures"]
        if kind == "counted":
            parts.append(
                f"The model is driven by counts ({names}), {figures['steps']:.0f} in all and "
                f"{figures['steps_a_sample']:.3g} a sample."
            )
        elif kind == "noisy":
            share = number(100 / max(figures["steps"], 1.0), 2)
            parts.append(f"The model is driven by readings with noise ({names}), {share} % of their range.")
        else:
            parts.append(
                f"The model is driven by readings in steps ({names}), {figures['steps']:.3g} of them over the range."
            )
    return " ".join(parts)


__all__ = ["misreading_sentences"]
