"""What noise of the first measured values does to estimates, where the states begin at these values."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.points import residuals
from plantfit.problem.problem import Problem
from plantfit.recording.record import Signal
from plantfit.simulate.simulator import Drive
from plantfit.trust.intervals.covariance import Begins, Block

# of the noise: an unstable plant makes radians of 1e-4 rad in a second, and differences are to stay on the tangent
STEP = 1e-3
START = "start_"  # of the parameter by which a state begins above its initial value
LOOKED_AT = 3  # recordings that tell whether the model begins at measured values


def first_value_effects(problem: Problem, z: np.ndarray, blocks: Sequence[Block]) -> Begins:
    """How one standard deviation of the noise of every such value changes the residuals at the cube point z (d,).

    The noise of a value is taken to be as large as the residuals of its output in its recording. No columns where
    states do not begin at measured values. The estimates then move by -(J'J)^-1 J' times a column, which the residuals
    do not show: the simulation begins where the measurement says. Where the fit has estimated this noise
    (`finish.start_corrections`), it is one more unknown.
    """
    effects, starts = value_effects(problem, z, blocks), problem.start_corrections
    found = [e for e in effects if e.output in starts.get(e.recording, ())]
    columns = [
        np.stack([e.column for e in own], axis=1)
        if own
        else np.zeros((max((b.rows.stop for b in blocks), default=0), 0))
        for own in ([e for e in effects if not any(e is f for f in found)], found)
    ]
    return Begins(columns[0], columns[1], np.array([0.0 if is_scored(problem, e) else 1.0 for e in found]))


class FreeStarts(NamedTuple):
    """Starts that the fit has estimated (`finish.start_corrections`), free beside the parameters of the linear problem.

    `columns` (n, l): what they do to the residuals, and below these to one row for each start whose value is no sample
    of the fit. `onto` (l, n): the starts that fit rows best, with the sign turned.
    """

    columns: np.ndarray
    onto: np.ndarray

    def left(self, rows: np.ndarray) -> np.ndarray:
        """What starts cannot take up (n, ...) of residuals (m,) or of their derivatives (m, d)."""
        more = len(self.columns) - len(rows)
        rows = np.concatenate([rows, np.zeros((more, *rows.shape[1:]))]) if more else rows
        return rows - self.columns @ (self.onto @ rows)


def free_starts(problem: Problem, z: np.ndarray, blocks: Sequence[Block]) -> FreeStarts | None:
    """Those of the problem at its answer z (d,); nothing where the fit has estimated none."""
    if not problem.start_corrections:
        return None
    return free_of(first_value_effects(problem, z, blocks), residuals(problem, z))


def free_of(begins: Begins, residuals: np.ndarray) -> FreeStarts | None:
    """The same from what noise of first values does to residuals (m,)."""
    if not begins.estimated.shape[1]:
        return None
    size = float(np.sqrt(np.mean(residuals**2)))
    columns = np.vstack([begins.estimated, size * np.diag(np.sqrt(begins.known))[begins.known > 0]])
    return FreeStarts(columns, np.linalg.pinv(columns))


class ValueEffect(NamedTuple):
    """What one standard deviation of the `noise` of a first measured value, in its unit, does to the residuals: a
    `column` (m,)."""

    recording: str
    output: str
    noise: float
    column: np.ndarray


def value_effects(problem: Problem, z: np.ndarray, blocks: Sequence[Block]) -> list[ValueEffect]:
    """Of every first value that states begin at, where it can be told; see `first_value_effects`."""
    here = residuals(problem, z)
    keys = [(n, o) for n in problem.data["drive"] for o in problem.outputs if len(problem.data["index"][n][o])]
    rows_of = dict(zip(keys, (b.rows for b in blocks), strict=True))
    found = []
    for output in _not_taken(problem, z):
        noise = {n: _noise(here, rows, problem, n, o) for (n, o), rows in rows_of.items() if o == output}
        above, below = (residuals(_moved(problem, output, noise, step), z) for step in (STEP, -STEP))
        for name in noise:
            column = np.zeros(len(here))
            for (owner, _), rows in rows_of.items():
                if owner == name:
                    column[rows] = (above - below)[rows] / (2 * STEP)
            if np.all(np.isfinite(column)):
                found.append(ValueEffect(name, output, noise[name], column))
    return found


def is_scored(problem: Problem, effect: ValueEffect) -> bool:
    """Whether the first value is a sample of the fit, whose residual tells how far off the start is."""
    measured = np.flatnonzero(np.isfinite(problem.experiments[effect.recording].recording[effect.output]))
    index = problem.data["index"][effect.recording][effect.output]
    return bool(len(index) and index[0] == measured[0])


def outputs_begun_at(problem: Problem, z: np.ndarray) -> list[str]:
    """Outputs whose first measured value enters the states at the start, by the first recordings that have one."""
    return list(states_begun_at(problem, z))


def _not_taken(problem: Problem, z: np.ndarray) -> list[str]:
    """The same without those whose noise free parameters take up: where each such state begins a free amount `start_x`
    above its value in every recording, as in pieces of a record, that is one unknown and not two."""
    values = np.asarray(problem.space.physical(np.asarray(z, dtype=float)))
    taken = {p.removeprefix(START) for p in start_parameters(problem, values) if _own(problem, p)}
    return [o for o, states in states_begun_at(problem, z).items() if not taken.issuperset(states)]


def _own(problem: Problem, name: str) -> bool:
    """Whether a parameter is the free start of a state (an extension), with a value for every recording."""
    parameter = problem.space.parameters[name]
    free = parameter.value is None and parameter.tied is None
    return name.startswith(START) and free and (parameter.per_recording or len(problem.experiments) == 1)


def states_begun_at(problem: Problem, z: np.ndarray) -> dict[str, tuple[str, ...]]:
    """By output the states that begin elsewhere where its first measured value is another one, by the first recordings
    that have one; outputs on which none depends are not among them."""
    if not problem.predictor.has_steps:
        return {}
    simulator, values = problem.predictor.stepping(), problem.space.physical(np.asarray(z, dtype=float))
    found = {}
    for place, output in enumerate(simulator.vector.outputs):
        measured = [
            (n, d)
            for n, d in problem.data["drive"].items()
            if isinstance(d, Drive) and np.isfinite(d.first_output[place])
        ]
        for name, drive in measured[:LOOKED_AT]:
            first = drive.first_output
            p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
            other = tuple(v + (1e-3 * abs(v) + 1e-6) * (k == place) for k, v in enumerate(first))
            begin, moved = (simulator.initial(p, drive.first_input, seen) for seen in (first, other))
            begun = zip(simulator.vector.states, begin, moved, strict=True)
            if states := tuple(s for s, a, b in begun if float(a) != float(b)):
                found[output] = states
                break
    return found


def start_parameters(problem: Problem, values: np.ndarray) -> set[str]:
    """Parameters that enter the states at the start, at values (d,) in their units, by the first recordings."""
    if not problem.predictor.has_steps:
        return set()
    simulator, found = problem.predictor.stepping(), set()
    moving = [(n, d) for n, d in problem.data["drive"].items() if isinstance(d, Drive)]
    for name, drive in moving[:LOOKED_AT]:
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        for parameter in problem.space.parameters:
            other = {**p, parameter: p[parameter] + 1e-3 * np.abs(p[parameter]) + 1e-6}
            begin, moved = (simulator.initial(own, drive.first_input, drive.first_output) for own in (p, other))
            if any(float(a) != float(b) for a, b in zip(begin, moved, strict=True)):
                found.add(parameter)
    return found


def _noise(here: np.ndarray, rows: slice, problem: Problem, name: str, output: str) -> float:
    """Standard deviation of the noise of an output in one recording, in its unit."""
    free = max(1.0, len(here) - problem.space.dimension)
    weight = 1.0 if problem.weights is None else float(problem.weights[name])
    return float(np.sqrt(np.mean(here[rows] ** 2) * len(here) / free / weight)) * float(problem.scales[output])


def _moved(problem: Problem, output: str, noise: Mapping[str, float], step: float) -> Problem:
    """The problem with the first measured value of one output moved in every recording, by so much of its noise.

    Where the fit corrects the start at it, the start is moved alone.
    """
    recordings, starts = {}, problem.start_corrections
    for name, experiment in problem.experiments.items():
        record = recordings[name] = experiment.recording
        if output in starts.get(name, ()):
            starts[name][output] += step * noise.get(name, 0.0)
            continue
        y = np.array(record[output], dtype=float)
        seen = np.flatnonzero(np.isfinite(y))
        if len(seen):
            y[seen[0]] += step * noise.get(name, 0.0)
        signals = {**record.signals, output: Signal(y, record.signals[output].unit)}
        recordings[name] = dataclasses.replace(record, signals=signals)
    if any(r is not problem.experiments[n].recording for n, r in recordings.items()):
        problem = problem.with_recordings(recordings)
    return problem.with_starts(starts) if starts else problem
