"""What the estimates of several methods say, in sentences."""

from collections.abc import Mapping, Sequence
from typing import Any

from plantfit.estimate.methods.estimates_record import GENERALISED, LEAST_SQUARES
from plantfit.findings.record import Level
from plantfit.findings.results.estimated import (
    CorrelatedNoise,
    EstimatedParameter,
    EstimateOfMethod,
    EstimatesByMethod,
)
from plantfit.findings.verdict import Sentence
from plantfit.problem.correlated.limits import FEW, LEFT, SLOW, by_chance
from plantfit.recording.told import together


def verdict_of(record: EstimatesByMethod, at_bound: Sequence[str] | None) -> list[Sentence]:
    """Sentences with a level about the record of `estimate_parameters`; `at_bound` names what the likelihood holds
    at a bound of its range, None where it was not maximised."""
    told: list[Sentence] = []

    def say(level: Level, sentence: str) -> None:
        told.append(Sentence(level=level, sentence=sentence))

    apart = [p for p in record.agreement if p.differs]
    if apart:
        for p in apart:
            say("warning", p.sentence)
    elif record.agreement:
        least = min(record.agreement, key=lambda p: p.p_adjusted or 0.0)
        names = together(record.methods)
        said = f"{names[:1].upper()}{names[1:]} agree: no two differ by more than chance lets them"
        say("good", f"{said} (smallest p {least.p_adjusted:.2g}, {least.first} and {least.second}).")
    moved = [r.name for r in record.noise if r.kind == "process" and r.value > 0]
    if moved:
        say(
            "info",
            f"The plant wanders ({together(moved)}): least squares takes that for errors of the sensors, "
            "maximum likelihood and the filters do not; where they differ, believe the likelihood "
            '(estimator = "maximum likelihood" in the study file makes it the answer of `plantfit run`).',
        )
    elif at_bound is not None:
        say(
            "info",
            "The recordings ask for no process noise: least squares and maximum likelihood assume the same here.",
        )
    for methods, (consistent, sentence) in _alike(
        {f.method: (f.nis.consistent, f.nis.sentence) for f in record.filters}
    ):
        say("good" if consistent else "warning", f"{together(methods)}: {sentence}")
    for methods, told_of in _alike({f.method: _memory(f.memory, f.chance) for f in record.filters}):
        if told_of:
            say("warning", f"{together(methods)}: {told_of}")
    if at_bound:
        say(
            "info",
            f"Held at a bound of its range: {together(list(at_bound))}; "
            "what stands beside it looks better known than it is.",
        )
    for noise in record.correlated:
        say("info", _taken(noise))
        if noise.independent < FEW:
            say(
                "warning",
                f"That is too few to know how slow the noise of {noise.output} is, so {GENERALISED} has no intervals. "
                "Residuals so slow mostly show that the model lacks something (`plantfit diagnose`).",
            )
        elif not by_chance(noise.left, noise.samples):
            say(
                "warning",
                f"Neighbouring residuals of {noise.output} are still correlated ({noise.left:.2f}) when this is taken "
                f"out: intervals of {GENERALISED} are {'too narrow' if noise.left > 0 else 'too wide'}.",
            )
    if shorter := _shorter(record):
        slow = any(n.independent < SLOW * n.samples for n in record.correlated)
        say("warning" if slow else "info", shorter)
    known = [p for p in record.parameters if p.truth is not None]
    for methods, held in _alike({method: _held(known, method) for method in record.methods} if known else {}):
        say("info", f"{'By each of' if len(methods) > 1 else 'Of'} {together(methods)}, {held}.")
    return told


def _taken(noise: CorrelatedNoise) -> str:
    """What generalised least squares takes the noise of an output for."""
    unit = f" {noise.unit}" if noise.unit and noise.unit != "1" else ""
    said = f"{GENERALISED.capitalize()}: the noise of {noise.output} is {noise.deviation:.3g}{unit}"
    if noise.form is not None and noise.shared is not None:
        size = f"{100 * noise.shared:.2g} %" if noise.form.endswith("proportion") else f"{noise.shared:.3g}{unit}"
        what = "at edges that neighbouring numbers share" if noise.form.startswith("edges") else "of every number"
        said += f" beside errors of {size} {what} (shared_errors)"
    if noise.order == 0:
        return f"{said}, and white."
    worth = (
        f"{noise.samples} samples tell as much as "
        + (f"{noise.independent:.0f} independent ones" if noise.independent >= 1.5 else "one")
        if noise.independent < 0.95 * noise.samples
        else "which costs no information"
    )
    return f"{said}, and correlated between neighbours ({noise.correlation:.2f}, order {noise.order}): {worth}."


def _shorter(record: EstimatesByMethod) -> str:
    """How long intervals of generalised least squares are beside those of least squares, and on what condition."""
    ratios = []
    for p in record.parameters:
        own, least = p.estimates.get(GENERALISED), p.estimates.get(LEAST_SQUARES)
        widths = [_width(e) for e in (own, least)]
        if widths[0] is not None and widths[1]:
            ratios.append(widths[0] / widths[1])
    if not ratios:
        return ""
    shown = f"{min(ratios):.2g}" if len(ratios) == 1 else f"{min(ratios):.2g} to {max(ratios):.2g}"
    return (
        f"Intervals of {GENERALISED} are {shown} times as long as those of least squares. They hold if what is "
        "correlated is noise; residuals of a model that lacks something are correlated too (`plantfit diagnose`)."
    )


def _width(estimate: EstimateOfMethod | None) -> float | None:
    """How long an interval is; None where an end is not known."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return None
    return estimate.high - estimate.low


def _alike(told: Mapping[str, Any]) -> list[tuple[list[str], Any]]:
    """Names of which the same is told, together, in the order in which they come."""
    found: dict[Any, list[str]] = {}
    for name, what in told.items():
        found.setdefault(what, []).append(name)
    return [(names, what) for what, names in found.items()]


def _memory(memory: Mapping[str, float | None], chance: Mapping[str, float | None]) -> str:
    """What correlated innovations do to the intervals of a filter; nothing where they are not correlated, or no more
    than by chance."""
    strong = {n: r for n, r in memory.items() if r is not None and abs(r) > max(LEFT, chance.get(n) or 0.0)}
    if not strong:
        return ""
    shown = ", ".join(f"{r:.2f} of {n}" for n, r in strong.items())
    narrow = "too narrow" if max(strong.values(), key=abs) > 0 else "too wide"
    return (
        f"neighbouring innovations are correlated ({shown}): intervals of filters "
        f"are {narrow}, those of least squares and maximum likelihood allow for it."
    )


def _held(known: Sequence[EstimatedParameter], method: str) -> str:
    holds = {p.name: inside for p in known if (inside := _holds(p, method)) is not None}
    missed = [name for name, inside in holds.items() if not inside]
    tail = f", not {together(missed)}" if missed else ""
    return f"{len(holds) - len(missed)} of {len(holds)} intervals hold the truth{tail}"


def _holds(p: EstimatedParameter, method: str) -> bool | None:
    """Whether the interval of a method holds the truth; None where an end or the truth is not known."""
    own = p.estimates.get(method)
    if own is None or own.low is None or own.high is None or p.truth is None:
        return None
    return own.low <= p.truth <= own.high
