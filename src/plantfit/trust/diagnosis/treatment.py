"""The lines of a study file that add what was found."""

from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.trust.diagnosis.candidates import Inside
from plantfit.trust.diagnosis.diagnose import Diagnosis
from plantfit.trust.diagnosis.ranges import rounded
from plantfit.trust.diagnosis.rounds import Trial


@dataclass(frozen=True)
class Change:
    """An addition for the study file: kind and signal of [model.extensions], bounds of its parameter and where to begin.

    `creep` is the speed from which dry friction is whole, `per_recording` whether every recording has its own value.
    """

    kind: str
    signal: str
    parameter: str
    bounds: tuple[float, float]
    start: float
    creep: float | None = None
    per_recording: bool = False


def changed(diagnosis: Diagnosis) -> list[Change]:
    """The changes of all rounds; of those that explain alike the first."""
    return [change_of(diagnosis, t) for t in diagnosis.found]


def change_of(diagnosis: Diagnosis, trial: Trial) -> Change:
    """The change that one trial proposes."""
    e, value = trial.extension, float(trial.value or 0.0)
    low, high = e.candidate.bounds(e.low, e.high, value)
    inside = diagnosis.carrier.creeps.get(e.signal) if e.kind == "coulomb" else None
    several = isinstance(e.candidate, Inside) and e.candidate.per_recording and len(diagnosis.carrier.given.experiments) > 1
    return Change(e.kind, e.signal, e.parameter, (low, high), min(max(rounded(value), low), high), inside, several)


def addition_lines(changes: Sequence[Change]) -> list[str]:
    """What to write into a study file by hand."""
    if not changes:
        return []
    kinds: dict[str, list[str]] = {}
    for c in changes:
        kinds.setdefault(c.kind, []).append(f"{c.signal} = [{c.bounds[0]:g}, {c.bounds[1]:g}]")
    lines = ["[model.extensions]", *(f"{kind} = {{ {', '.join(own)} }}" for kind, own in kinds.items())]
    for c in changes:
        lines += [f"[parameters.{c.parameter}]", f"start = {c.start:g}"]
        lines += ["per_recording = true"] if c.per_recording else []
        lines += [f"[parameters.creep_{c.signal}]", f"value = {c.creep:g}"] if c.creep is not None else []
    return lines
