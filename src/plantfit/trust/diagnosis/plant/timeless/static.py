"""What a static model may lack, as a characteristic of its inputs: an offset, a part by an input, its square or sign, a
product of two, a power, a parameter that changes with an input, and a dead zone, limit or offset of an input."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.extensions import KINDS, parameter_name, with_extensions
from plantfit.models.extensions.changes import REFERENCE, WITH
from plantfit.models.extensions.parts import SHAPES, parts_of, products_of, split, unit_of_part
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.space import Parameter
from plantfit.trust.diagnosis.candidates import CANDIDATES as ALL
from plantfit.trust.diagnosis.candidates import Before, Behind, Inside, part_of_an_output
from plantfit.trust.diagnosis.catalogue import MOST_PAIRS, Extension, made_of, seen_of
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.carrier import WIDE, Carrier, filled, rows_of
from plantfit.trust.diagnosis.plant.sizes import round_number
from plantfit.trust.diagnosis.ranges import Tried
from plantfit.trust.intervals.robust_or_classical import timed

BEFORE = ("dead_zone", "saturation", "input_offset")
BEHIND = ("offset", "sensor_high", "sensor_low")
CHANGE, POWER = "change", "power"


CANDIDATES: dict[str, Inside] = {
    "proportional": part_of_an_output(
        "a", "part of {y} in proportion to {u}", "a part of {y} in proportion to {u} ({{0}})"
    ),
    "square": part_of_an_output("a", "part of {y} by the square of {u}", "a part of {y} by the square of {u} ({{0}})"),
    "signed_square": part_of_an_output(
        "a",
        "part of {y} by the square of {u} with its sign",
        "a part of {y} by the square of {u}, with its sign, ({{0}})",
    ),
    "sign": part_of_an_output("a", "part of {y} by the sign of {u}", "a part of {y} by the sign of {u} ({{0}})"),
    "product": part_of_an_output("a", "part of {y} by {u} times {v}", "a part of {y} by {u} times {v} ({{0}})"),
    "power": part_of_an_output("a", "power of {u} on {y}", "a further power {{0}} of {u} on all of {y}"),
}
"""In the order in which parts that explain alike are named; name and phrase take output and inputs."""


@dataclass(frozen=True)
class PartExtension(Extension):
    """A part that an output of a static model may lack; `signal` is "y with u" or "y with u and v"."""

    @property
    def candidate(self) -> Inside:
        y, inputs = split(self.signal)
        row = CANDIDATES[self.kind]
        phrase = row.phrase.format(**dict(zip("yuv", (y, *inputs), strict=False)))
        return replace(row, phrase=phrase)


def static(problem: Problem) -> bool:
    """Whether a problem is one of a model that has no states, or is at rest in every recording."""
    rest = all(e.steady for e in problem.experiments.values())
    return isinstance(problem.model, Model) and (rest or not problem.model.states)


def unordered(problem: Problem) -> bool:
    """Whether the rows of a static problem are in no order that tells anything."""
    moving = problem.in_time and not all(e.steady for e in problem.experiments.values())
    return static(problem) and not moving and not timed(problem)


def inside_of(problem: Problem) -> dict[str, tuple[str, ...]]:
    """The parts, powers and changes that a static model may lack: kind -> pairs as a study file names them."""
    model = problem.model
    assert isinstance(model, Model)
    had = {p.name for p in model.parameters}
    moving = {u: v for u in model.inputs if np.ptp(v := _values(problem, u)) > 0}
    found: dict[str, list[str]] = {kind: [] for kind in (*CANDIDATES, CHANGE)}
    for signal in parts_of(model):
        _, (u,) = split(signal)
        if u not in moving:
            continue
        v = moving[u]
        two_sided = bool(np.min(v) < 0 < np.max(v))
        for kind in ("proportional", "square"):
            found[kind].append(signal)
        for kind in ("signed_square", "sign") if two_sided else ():
            found[kind].append(signal)
        if np.min(v) > 0:
            found[POWER].append(signal)
    for signal in products_of(model):
        if all(u in moving for u in split(signal)[1]):
            found["product"].append(signal)
    brought = {p.name for p in model.parameters if p.name.startswith(tuple(f"{k}_" for k in KINDS))}
    free = dict.fromkeys(c.parameter for c in problem.space.coordinates if c.parameter not in brought)
    known = KINDS[CHANGE].signals(model)
    pairs = (f"{s}{WITH}{u}" for s in (*free, *moving) for u in moving if s != u)
    found[CHANGE] = list(islice((p for p in pairs if p in known), MOST_PAIRS))
    return {k: tuple(s for s in own if parameter_name(k, s) not in had) for k, own in found.items()}


def extensions_of_static(problem: Problem) -> list[Extension]:
    """What a static model may lack, in the order in which equals are named: changes last."""
    model = problem.model
    assert isinstance(model, Model)
    had = {p.name for p in model.parameters}
    every = [*_at_ends(problem, model), *_inside(problem, model)]
    return [e for e in every if e.parameter not in had]


def _at_ends(problem: Problem, model: Model) -> Iterator[Extension]:
    """What may be before the model or behind it."""
    for y, unit in model.outputs.items():
        seen = seen_of(problem, unit, _values(problem, y))
        for kind in BEHIND:
            candidate = ALL[kind]
            assert isinstance(candidate, Behind)
            yield from made_of(kind, candidate, y, candidate.tried(seen))
    for u, unit in model.inputs.items():
        values = _values(problem, u)
        for kind in BEFORE if np.ptp(values) > 0 else ():
            candidate = ALL[kind]
            assert isinstance(candidate, Before)
            yield from made_of(kind, candidate, u, candidate.tried(seen_of(problem, unit, values)))


def _inside(problem: Problem, model: Model) -> Iterator[Extension]:
    change = ALL[CHANGE]
    assert isinstance(change, Inside)
    for kind, signals in inside_of(problem).items():
        for signal in signals:
            if kind == CHANGE:
                unit = change.unit(model.inputs[signal.split(WITH)[1]])
                yield from made_of(kind, change, signal, Tried(unit, change.low, np.inf))
                continue
            y, inputs = split(signal)
            row = CANDIDATES[kind]
            unit = "1" if kind == POWER else unit_of_part(model, kind, signal)
            name = row.name.format(**dict(zip("yuv", (y, *inputs), strict=False)))
            yield PartExtension(kind, signal, name, row.article, unit, row.low, np.inf)


def carrier_of_static(problem: Problem, z: np.ndarray, meter: Meter | None = None) -> Carrier:
    """A carrier at the cube point z (d,) with all parts, powers and changes of a static model inside."""
    model, kinds = problem.model, inside_of(problem)
    assert isinstance(model, Model)
    sizes = {(kind, s): _size(problem, kind, s) for kind, own in kinds.items() for s in own}
    bounds = {kind: {s: (-sizes[kind, s], sizes[kind, s]) for s in own} for kind, own in kinds.items() if own}
    changes: dict[str, Parameter] = {n: replace(p, smooth=None) for n, p in problem.space.parameters.items()}
    changes |= {parameter_name(k, s): Parameter((-size, size)) for (k, s), size in sizes.items()}
    fixed = {
        parameter_name(REFERENCE, s): _reference(_values(problem, s.split(WITH)[1]))
        for kind in (CHANGE, POWER)
        for s in kinds[kind]
    }
    changes |= {name: Parameter(value=value) for name, value in fixed.items()}
    inputs = {
        n: {u: np.asarray(e.recording[u], dtype=float) for u in model.inputs} for n, e in problem.experiments.items()
    }

    def whole(recording: Recording, own: Mapping[str, np.ndarray]) -> Recording:
        return filled(recording, own, model.outputs)

    experiments = {
        n: replace(e, recording=whole(e.recording, inputs[n]), fit=(-np.inf, np.inf), validate=None, skip=0.0)
        for n, e in problem.experiments.items()
    }
    extended = with_extensions(model, bounds) if bounds else model
    made = Problem(extended, experiments, changes, scales=problem.scales, name=problem.name)
    inside = {(k, s): (made.space.names.index(parameter_name(k, s)),) for k, s in sizes}
    rows = rows_of(problem, problem.space.dimension)
    return Carrier(
        made, problem, rows, np.asarray(z, dtype=float), problem.space.dimension, inside, {}, fixed, inputs,
        meter or Meter(), unordered=unordered(problem),
    )  # fmt: skip


def _values(problem: Problem, name: str) -> np.ndarray:
    every = np.concatenate([np.asarray(e.recording[name], dtype=float) for e in problem.experiments.values()
                            if name in e.recording.signals])  # fmt: skip
    return every[np.isfinite(every)]


def _reference(values: np.ndarray) -> float:
    """A round number near the mean, above 0 where all values are."""
    near = round_number(float(np.mean(values)), float(np.std(values)))
    return near if near > 0 or np.min(values) <= 0 else float(np.mean(values))


def _size(problem: Problem, kind: str, signal: str) -> float:
    """A size of an addition that would be seen at once, many times, as a power of two."""
    if kind == POWER:
        size = 1.0
    elif kind == CHANGE:
        size = 1.0 / max(float(np.std(_values(problem, signal.split(WITH)[1]))), 1e-300)
    else:
        y, inputs = split(signal)
        records = [[np.asarray(e.recording[u], dtype=float) for u in inputs] for e in problem.experiments.values()]
        shown = np.concatenate([np.asarray(SHAPES[kind][0](*own), dtype=float) for own in records])
        size = float(np.std(_values(problem, y))) / max(float(np.nanstd(shown)), 1e-300)
    return float(2.0 ** np.ceil(np.log2(WIDE * max(size, 1e-300))))


__all__ = ["CANDIDATES", "carrier_of_static", "extensions_of_static", "static", "unordered"]
