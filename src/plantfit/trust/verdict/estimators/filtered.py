"""What the verdict says where the answer is that of maximum likelihood or of a Kalman filter: noise moves the plant."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.problem.correlated.filtered_answer import FULL_NAMES
from plantfit.trust.verdict.estimators.lengths import compared
from plantfit.trust.verdict.outputs import WHITE, Findings, Row, disagree, is_same, place
from plantfit.trust.verdict.words import Sentence, say, some, span, with_unit

Place = tuple[str, str]  # recording and output


def named(estimator: str) -> str:
    """An estimator in words."""
    return FULL_NAMES.get(estimator, estimator)


def moved_by_noise(findings: Findings) -> dict[Place, Row]:
    """Where the answer is that of a filter with noise that moves the plant, which is none unless nothing is left of the
    outputs that it foretells: tests of its errors one sample ahead by recording and output."""
    found = findings.get("filtered") or {}
    moving = any(n["kind"] == "process" and n["value"] > 0.0 for n in found.get("noise", ()))
    return {_place(t): t for t in found["tests"] if not t.get("shared")} if moving else {}


def ahead_of(findings: Findings, row: Row, part: str) -> Row | None:
    """How far the output of a row is off in a part of its recording, one sample ahead."""
    found = (findings.get("filtered") or {}).get("ahead", ())
    return next((a for a in found if a["part"] == part and is_same(a, row)), None)


def filtered_sentences(findings: Findings) -> Iterator[Sentence]:
    """What the estimator takes for noise, what it gains, and whether it foretells as well as it thinks."""
    found = findings.get("filtered")
    if not found:
        return
    yield _taken(findings, found)
    told = found["filter"]
    if not told["nis"]["consistent"]:
        yield say("warning", f"{_begin(told['method'])}: {told['nis']['sentence']}")
    if moved_by_noise(findings) and (_shown(findings) or disagree(findings)):
        yield say(
            "warning",
            "These intervals take what a simulation leaves for noise that moves the plant, and it is not noise alone: "
            'mend the model first, or take estimator = "least squares", whose intervals may be wider.',
        )


def wandering_sentences(findings: Findings) -> Iterator[Sentence]:
    """Outputs whose residuals are those of a plant that noise moves."""
    moved = moved_by_noise(findings)
    simulated = [t for t in findings.get("residual_tests", ()) if _place(t) in moved]
    for output in dict.fromkeys(t["output"] for t in simulated):
        own = [t for t in simulated if t["output"] == output]
        if coloured := [t for t in own if not t["white"]]:
            yield _wandering(findings, coloured, [moved[_place(t)] for t in coloured], len(own))


def _taken(findings: Findings, found: Mapping[str, Any]) -> Sentence:
    """Whose parameters these are, and how long their intervals are beside those of least squares."""
    moving = [n for n in found["noise"] if n["kind"] == "process" and n["value"] > 0.0]
    sensors = [n for n in found["noise"] if n["kind"] == "measurement"]
    text = f"The parameters are those of {named(found['estimator'])}, "
    of_sensors = f"that of the sensors ({_sizes(sensors)})"
    text += (
        f"with noise that moves the plant ({_sizes(moving)}) beside {of_sensors}"
        if moving
        else f"with noise of the sensors ({_sizes(sensors)}) alone: the recordings ask for none that moves the plant"
    )
    lengths = compared(found["least_squares"], {p["name"]: p for p in findings["parameters"]})
    text += f"; {lengths[0]}" if lengths else ""
    if found["differs"] and found["moved"] is not None:
        least = next(p for p in found["least_squares"] if p["name"] == found["moved"])
        text += (
            f". Least squares, which takes all of it for noise of the sensors, differs by more than chance (p = "
            f"{found['p']:.2g}), most in {found['moved']}: {with_unit(least['value'], least['unit'])}"
        )
    return say("info", f"{text}.", **({"ratio": lengths[1]} if lengths else {}))


def _sizes(levels: Sequence[Row]) -> str:
    return some([f"{with_unit(n['value'], n['unit'])} of {n['name']}" for n in levels])


def _wandering(findings: Findings, simulated: Sequence[Row], ahead: Sequence[Row], of: int) -> Sentence:
    output, one = simulated[0]["output"], of == 1
    where = place(findings, simulated[0]) if one else f"{output} in {len(simulated)} of {of} recordings"
    most = max(_next(t) for t in simulated)
    errors = [a for t in simulated if (a := ahead_of(findings, t, "fit")) is not None]
    size = f"is off by {span([a['rmse'] for a in errors], errors[0]['unit'])} rms, and " if errors else ""
    least = min(t["p_value"] for t in ahead)
    white = "white" if least > WHITE else "white but for what chance leaves in one of some hundred records"
    text = (
        f"The residuals of {where} are not white (correlation {'' if one else 'up to '}{most:.2f} from one sample to "
        f"the next), as a plant leaves them that noise moves: foretold one sample ahead, {output} {size}"
        f"{'these errors are' if size else 'it leaves errors that are'} {white} "
        f"(p = {least:.2g}{'' if one else ' or more'})."
    )
    return say("info" if _shown(findings) else "good", text, correlation=most)


def _next(row: Row) -> float:
    return row["autocorrelation"][1] if len(row["autocorrelation"]) > 1 else 0.0


def _place(row: Row) -> Place:
    return row["recording"], row["output"]


def _shown(findings: Findings) -> bool:
    """Whether the diagnosis shows more than a possible fault of the model."""
    made = findings.get("diagnosis") or {}
    likely = any(r.get("likely") in ("likely", "very likely") for r in made.get("rounds", ()))
    return likely or bool(made.get("repeating") or made.get("stepping"))


def _begin(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


__all__ = ["ahead_of", "filtered_sentences", "moved_by_noise", "named", "wandering_sentences"]
