"""The lines of a study file that add what was found."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plantfit.models.extensions import KINDS, parameter_name
from plantfit.models.extensions.steps import moment_of
from plantfit.models.extensions.terms import OVER
from plantfit.recording.clean.outliers import step_without
from plantfit.trust.diagnosis.candidates import Inside
from plantfit.trust.diagnosis.diagnose import Diagnosis
from plantfit.trust.diagnosis.plant.carrier import FASTEST, SLOWEST
from plantfit.trust.diagnosis.plant.curves import KIND, Curve
from plantfit.trust.diagnosis.plant.cycles import COUNT, DAY, Place
from plantfit.trust.diagnosis.plant.hypothesis import speed_places
from plantfit.trust.diagnosis.plant.stepping.moments import StepPlace
from plantfit.trust.diagnosis.ranges import both_signs, rounded
from plantfit.trust.diagnosis.rounds import Trial


@dataclass(frozen=True)
class Change:
    """An addition for the study file: its `name`, kind and signal of [model.extensions], bounds of its parameter and
    where to begin.

    `values` are parameters that come with it, `ranges` those of them that are fitted (low, high, start); with
    `per_recording` every recording has its own value. A curve in time has `nodes` (from, to in s, count), and its bends
    are kept small; a pattern that repeats has a `period` (s) with so many values, a step a `moment` (s): between two,
    and where to begin.
    """

    name: str
    kind: str
    signal: str
    parameter: str
    bounds: tuple[float, float]
    start: float
    values: tuple[tuple[str, float], ...] = ()
    ranges: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    per_recording: bool = False
    nodes: tuple[float, float, int] | None = None
    period: tuple[float, int] | None = None
    moment: tuple[float, float, float] | None = None


SMOOTH = "reml"  # of curves in time


def changed(diagnosis: Diagnosis) -> list[Change]:
    """The changes of all rounds, of those that explain alike the first, and a curve for what wanders beside them or
    in their place."""
    beside = diagnosis.beside
    trials = [t for t in diagnosis.found if beside is None or t.extension in beside]
    return _named_apart([*(change_of(diagnosis, t) for t in trials), *_of_time(diagnosis)])


def asked_changes(diagnosis: Diagnosis) -> list[Change]:
    """Those that were asked for, whatever they explain."""
    return _named_apart([*(change_of(diagnosis, r.trials[0]) for r in diagnosis.rounds if r.trials),
                         *_of_time(diagnosis)])  # fmt: skip


def _named_apart(changes: Sequence[Change]) -> list[Change]:
    """Of two columns with one pair over two scales the later parameter ends in _2, as the model calls it
    (`term_names`)."""
    named: dict[str, int] = {}
    apart = []
    for c in changes:
        k = named[c.parameter] = named.get(c.parameter, 0) + 1
        apart.append(c if k == 1 or OVER not in c.signal else replace(c, parameter=f"{c.parameter}_{k}"))
    return apart


def clean_steps(diagnosis: Diagnosis) -> dict[str, list[dict[str, Any]]]:
    """Cleaning steps by recording, where outliers are named."""
    found: dict[str, list[dict[str, Any]]] = {}
    for name, _, step, _ in _removals(diagnosis):
        found.setdefault(name, []).append(step)
    return found


def outliers_taken(diagnosis: Diagnosis, output: str) -> tuple[str, int]:
    """What takes the outliers of an output away, and how many of them."""
    own = [(step, taken) for _, o, step, taken in _removals(diagnosis) if o == output]
    return " and ".join(dict.fromkeys(str(step["step"]) for step, _ in own)), sum(taken for _, taken in own)


def _removals(diagnosis: Diagnosis) -> Iterator[tuple[str, str, dict[str, Any], int]]:
    """Recording, output, step and how many it takes."""
    if not diagnosis.outliers.named:
        return
    rows, given = diagnosis.carrier.rows, diagnosis.carrier.given
    for name, e in given.experiments.items():
        for output in given.outputs:
            at = rows.part(name, output)
            marked = np.zeros(len(e.recording), dtype=bool)
            marked[rows.sample[at[diagnosis.apart[at]]]] = True
            if marked.any():
                yield name, output, *step_without(output, e.recording[output], e.recording.t, marked)


def _of_time(diagnosis: Diagnosis) -> list[Change]:
    return [*map(_of_curve, diagnosis.curves), *map(_of_place, diagnosis.places),
            *map(_of_step, diagnosis.stepped)]  # fmt: skip


def _of_step(p: StepPlace) -> Change:
    low, high = both_signs(*p.bounds, p.size)
    bounds = (max(low, rounded(p.bounds[0])), min(high, rounded(p.bounds[1])))
    return Change(p.name, p.kind, p.signal, p.parameter, bounds, rounded(p.size), moment=(*p.between, p.at))


def _of_place(p: Place) -> Change:
    wide = rounded(p.wide)
    return Change(
        p.name, p.kind, p.signal, p.parameter, (-wide, wide), 0.0, per_recording=p.several, period=(DAY, COUNT)
    )


def _of_curve(c: Curve) -> Change:
    low, high = (rounded(b) for b in c.bounds)
    return Change(
        c.name, KIND, c.output, c.parameter, (low, high), 0.0, per_recording=c.several, nodes=(c.begin, c.end, c.count)
    )


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
    several = (
        isinstance(e.candidate, Inside) and e.candidate.per_recording and len(diagnosis.carrier.given.experiments) > 1
    )
    start = min(max(rounded(value), low), high)
    return Change(e.name, e.kind, e.signal, e.parameter, (low, high), start, tuple(values), tuple(ranges), several)


def addition_lines(changes: Sequence[Change]) -> list[str]:
    """What to write into a study file by hand."""
    if not changes:
        return []
    kinds: dict[str, list[str]] = {}
    for c in changes:
        signal = c.signal if c.signal.isidentifier() else f'"{c.signal}"'
        kinds.setdefault(c.kind, []).append(f"{signal} = {_bounds(c)}")
    lines = ["[model.extensions]", *(f"{kind} = {{ {', '.join(own)} }}" for kind, own in kinds.items())]
    values = {name: value for c in changes for name, value in c.values}
    for c in changes:
        lines += [f"[parameters.{c.parameter}]", f"start = {c.start:g}"]
        lines += ["per_recording = true"] if c.per_recording else []
        lines += [f'smooth = "{SMOOTH}"'] if c.nodes else []
        lines += [f"[parameters.{moment_of(c.parameter)}]", f"start = {c.moment[2]:.6g}"] if c.moment else []
        for name, (low, high, start) in c.ranges:
            lines += [f"[parameters.{name}]", f"bounds = [{low:g}, {high:g}]", f"start = {start:g}"]
    for name, value in values.items():
        lines += [f"[parameters.{name}]", f"value = {value:g}"]
    return lines


def _bounds(c: Change) -> str:
    pair = f"[{c.bounds[0]:g}, {c.bounds[1]:g}]"
    if c.period is not None:
        return f"{{ bounds = {pair}, period = {c.period[0]:g}, count = {c.period[1]} }}"
    if c.moment is not None:
        return f"{{ bounds = {pair}, at = [{c.moment[0]:.6g}, {c.moment[1]:.6g}] }}"
    if c.nodes is None:
        return pair
    begin, end, count = c.nodes
    return f"{{ bounds = {pair}, nodes = {{ from = {begin:.6g}, to = {end:.6g}, count = {count} }} }}"
