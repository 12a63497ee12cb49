"""What the estimates of several methods say, in sentences."""

from collections.abc import Mapping, Sequence
from typing import Any

from plantfit.findings.record import Level
from plantfit.findings.results.estimated import EstimatedParameter, EstimatesByMethod
from plantfit.findings.verdict import Sentence
from plantfit.recording.told import listed

MEMORY = 0.1  # correlation of neighbouring innovations from which on intervals of filters are called too narrow


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
        names = listed(record.methods)
        said = f"{names[:1].upper()}{names[1:]} agree: no two differ by more than chance lets them"
        say("good", f"{said} (smallest p {least.p_adjusted:.2g}, {least.first} and {least.second}).")
    moved = [r.name for r in record.noise if r.kind == "process" and r.value > 0]
    if moved:
        say(
            "info",
            f"The plant wanders ({listed(moved)}): least squares takes that for errors of the sensors, "
            "maximum likelihood and the filters do not; where they differ, believe the likelihood.",
        )
    elif at_bound is not None:
        say(
            "info",
            "The recordings ask for no process noise: least squares and maximum likelihood assume the same here.",
        )
    for methods, (consistent, sentence) in _alike(
        {f.method: (f.nis.consistent, f.nis.sentence) for f in record.filters}
    ):
        say("good" if consistent else "warning", f"{listed(methods)}: {sentence}")
    for methods, told_of in _alike({f.method: _memory(f.memory, f.chance) for f in record.filters}):
        if told_of:
            say("warning", f"{listed(methods)}: {told_of}")
    if at_bound:
        say(
            "info",
            f"Held at a bound of its range: {listed(list(at_bound))}; "
            "what stands beside it looks better known than it is.",
        )
    known = [p for p in record.parameters if p.truth is not None]
    for methods, held in _alike({method: _held(known, method) for method in record.methods} if known else {}):
        say("info", f"{'By each of' if len(methods) > 1 else 'Of'} {listed(methods)}, {held}.")
    return told


def _alike(told: Mapping[str, Any]) -> list[tuple[list[str], Any]]:
    """Names of which the same is told, together, in the order in which they come."""
    found: dict[Any, list[str]] = {}
    for name, what in told.items():
        found.setdefault(what, []).append(name)
    return [(names, what) for what, names in found.items()]


def _memory(memory: Mapping[str, float | None], chance: Mapping[str, float | None]) -> str:
    """What correlated innovations do to the intervals of a filter; nothing where they are not correlated, or no more
    than by chance."""
    strong = {n: r for n, r in memory.items() if r is not None and abs(r) > max(MEMORY, chance.get(n) or 0.0)}
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
    tail = f", not {listed(missed)}" if missed else ""
    return f"{len(holds) - len(missed)} of {len(holds)} intervals hold the truth{tail}"


def _holds(p: EstimatedParameter, method: str) -> bool | None:
    """Whether the interval of a method holds the truth; None where an end or the truth is not known."""
    own = p.estimates.get(method)
    if own is None or own.low is None or own.high is None or p.truth is None:
        return None
    return own.low <= p.truth <= own.high
