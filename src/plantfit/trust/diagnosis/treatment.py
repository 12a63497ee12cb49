"""The lines of a study file that add what was found."""

from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.models.extensions import KINDS, parameter_name
from plantfit.trust.diagnosis.candidates import Inside
from plantfit.trust.diagnosis.diagnose import Diagnosis
from plantfit.trust.diagnosis.plant.carrier import FASTEST, SLOWEST
from plantfit.trust.diagnosis.plant.hypothesis import speed_places
from plantfit.trust.diagnosis.ranges import rounded
from plantfit.trust.diagnosis.rounds import Trial


@dataclass(frozen=True)
class Change:
    """An addition for the study file: kind and signal of [model.extensions], bounds of its parameter and where to begin.

    `values` are parameters that come with it, `ranges` those of them that are fitted (low, high, start); with `per_recording` every
    recording has its own value.
    """

    kind: str
    signal: str
    parameter: str
    bounds: tuple[float, float]
    start: float
    values: tuple[tuple[str, float], ...] = ()
    ranges: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    per_recording: bool = False


def changed(diagnosis: Diagnosis) -> list[Change]:
    """The changes of all rounds; of those that explain alike the first."""
    return [change_of(diagnosis, t) for t in diagnosis.found]


def change_of(diagnosis: Diagnosis, trial: Trial) -> Change:
    """The change that one trial proposes."""
    e, value = trial.extension, float(trial.value or 0.0)
    low, high = e.candidate.bounds(e.low, e.high, value)
    carrier, ranges = diagnosis.carrier, []
    beside = [parameter_name(part, e.signal) for part in (KINDS[e.kind].beside if e.kind in KINDS else ())]
    values = [(name, carrier.values[name]) for name in beside if name in carrier.values]
    for place in speed_places(carrier, e):
        assert trial.at is not None
        speed, spread = rounded(float(trial.at.x[place])), carrier.speeds[e.kind, e.signal][1]
        ranges.append((carrier.names[place], (rounded(SLOWEST * spread), rounded(FASTEST * spread), speed)))
    several = isinstance(e.candidate, Inside) and e.candidate.per_recording and len(diagnosis.carrier.given.experiments) > 1
    return Change(e.kind, e.signal, e.parameter, (low, high), min(max(rounded(value), low), high), tuple(values), tuple(ranges), several)


def addition_lines(changes: Sequence[Change]) -> list[str]:
    """What to write into a study file by hand."""
    if not changes:
        return []
    kinds: dict[str, list[str]] = {}
    for c in changes:
        signal = c.signal if c.signal.isidentifier() else f'"{c.signal}"'
        kinds.setdefault(c.kind, []).append(f"{signal} = [{c.bounds[0]:g}, {c.bounds[1]:g}]")
    lines = ["[model.extensions]", *(f"{kind} = {{ {', '.join(own)} }}" for kind, own in kinds.items())]
    values = {name: value for c in changes for name, value in c.values}
    for c in changes:
        lines += [f"[parameters.{c.parameter}]", f"start = {c.start:g}"]
        lines += ["per_recording = true"] if c.per_recording else []
        for name, (low, high, start) in c.ranges:
            lines += [f"[parameters.{name}]", f"bounds = [{low:g}, {high:g}]", f"start = {start:g}"]
    for name, value in values.items():
        lines += [f"[parameters.{name}]", f"value = {value:g}"]
    return lines
