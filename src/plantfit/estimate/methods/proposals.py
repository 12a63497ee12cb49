"""Noise levels that are proposed where a user gives none: from the residuals and from how far the states move."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError, RecordingError
from plantfit.estimate.filters.kalman import ekf
from plantfit.estimate.filters.noise import Level, Noise
from plantfit.estimate.filters.state_space import StateSpace, jacobian, state_space
from plantfit.problem.problem import GENERALISED, Problem
from plantfit.simulate.simulator import ADAPTIVE, Simulator

import jax.numpy as jnp

FINEST, STEP_ERROR = 64, 0.02  # equal steps a sample; their error as a share of the residual
NARROW, WIDE = 0.02, 3.0  # bounds of a measurement level: of the scatter from sample to sample, of the residual
LEAST = 1e-4  # of its own spread that process noise moves a state by over a record, at least
FEW = 5.0  # samples in which process noise moves a state by its own spread, at most
KNOWN = 1e-3  # of its spread: how well a state is known that the model says where it begins
ROUNDING = 1e-12  # of the largest value of a state: one that moves less stays where it begins
FIRST = 10.0  # standard deviations of a measurement: how well a state is known that begins at one
DIFFERENCES = np.sqrt(6.0)  # what a second difference multiplies white noise by


@dataclass(frozen=True)
class Scales:
    """How large things are at given values: `residual` and `scatter` of outputs, `spread` of states, by name, in their
    units.

    `residual` is the root mean square of measured minus simulated, `scatter` what second differences of the record show
    of white noise. `begin` tells where a state begins: "parameter", "measured" or "model". `kinematic` states are the
    integral of another one. `period` and `span` are seconds from sample to sample and of a record.
    """

    residual: Mapping[str, float]
    scatter: Mapping[str, float]
    spread: Mapping[str, float]
    begin: Mapping[str, str]
    kinematic: Mapping[str, str]
    period: float
    span: float


@dataclass(frozen=True)
class Proposal:
    """`noise` as a filter takes it, `start` of the free levels by name ("process x"), `assumed`: a sentence for each
    thing not given, and the names of `proposed` levels."""

    noise: Noise
    start: Mapping[str, float]
    assumed: tuple[str, ...]
    proposed: frozenset[str]


def filterable(problem: Problem) -> None:
    """Raises ModelError or RecordingError for a problem that no Kalman filter works on."""
    steady = [n for n, e in problem.experiments.items() if e.steady]
    if steady:
        raise RecordingError(
            f"Recording {steady[0]!r} is steady, without time, and a Kalman filter runs over time; leave it out here."
        )
    state_space(problem, Noise({}, dict.fromkeys(problem.outputs, 1.0), dict.fromkeys(_states(problem), 1.0)))


def check_filterable(problem: Problem) -> None:
    """The same, with what may be done instead."""
    try:
        filterable(problem)
    except ModelError as error:
        without = f" without estimator = {problem.estimator!r}" if problem.by_filters else ""
        smooth = "Write dry friction as tanh(v/width) and leave backlash and resets out. " if _states(problem) else ""
        raise ModelError(
            f"{error} {smooth}`plantfit run`{without} "
            f'fits the model as it is, and so does `plantfit estimate --method "{GENERALISED}"`.'
        ) from None


def _states(problem: Problem) -> list[str]:
    return list(getattr(problem.model, "states", {}))


def stepped_evenly(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The problem with so many equal steps a sample that their error is small beside the residual; filters know no
    other steps."""
    stepping = problem.predictor.stepping()
    if stepping.stepper == ADAPTIVE:
        problem = problem.with_simulator(Simulator(stepping.vector, "exponential", 1, stepping.interpolated))
    elif not problem.mesh:
        return problem  # chosen already
    outputs, finer = _simulated(problem, values)[1], problem
    while finer.predictor.stepping().substeps < FINEST:
        again = finer.with_simulator(finer.predictor.stepping().refined(2))
        fine = _simulated(again, values)[1]
        moved = [
            np.nanstd(a - b) <= STEP_ERROR * np.nanstd(b)
            for n in fine
            for a, b in zip(outputs[n], fine[n], strict=True)
        ]
        if all(moved):
            return finer
        outputs, finer = fine, again
    return finer


def scales_at(problem: Problem, values: Mapping[str, float]) -> Scales:
    """Residuals, spreads and what begins where, of the fitted parts, simulated at named values."""
    plant, residuals, states, periods, spans = _over_records(problem, values)
    outputs, names = list(problem.outputs), list(plant.model.states)
    pooled = np.concatenate(residuals)
    residual = {n: float(np.sqrt(np.nanmean(pooled[:, i] ** 2))) for i, n in enumerate(outputs)}
    scatter = {n: _scatter([r[:, i] for r in residuals]) for i, n in enumerate(outputs)}
    spread = {}
    for i, n in enumerate(names):
        own = np.sqrt(np.mean([np.var(x[:, i]) for x in states]))
        largest = np.max([np.max(np.abs(x[:, i])) for x in states])
        spread[n] = float(own if own > ROUNDING * largest else largest)
    begin, kinematic = _begin(problem, plant, values), _kinematic(problem, plant, values, states[0])
    return Scales(residual, scatter, spread, begin, kinematic, float(np.median(periods)), float(np.mean(spans)))


def proposed(
    problem: Problem,
    scales: Scales,
    process: Mapping[str, Level],
    measurement: Mapping[str, Level],
    initial: Mapping[str, float],
) -> Proposal:
    """Levels as given, and for the rest ranges in which maximum likelihood finds them, with what was assumed."""
    own_process, own_measurement, own_initial = dict(process), dict(measurement), dict(initial)
    states = _states(problem)
    start: dict[str, float] = {}
    assumed: list[str] = []
    made: set[str] = set()
    for n in problem.outputs:
        if n in own_measurement:
            continue
        r, s = scales.residual[n], min(scales.scatter[n], scales.residual[n])
        r = max(r, 1e-12)
        low, high = max(NARROW * s, 1e-3 * r), WIDE * r
        own_measurement[n] = (low, high)
        start[f"measurement {n}"] = float(np.clip(s, 2 * low, r))
        made.add(f"measurement {n}")
        assumed.append(f"measurement {n}: between {low:.3g} and {high:.3g}, from the residual of {r:.3g}")
    for n in states if not process else ():
        if n in scales.kinematic:
            assumed.append(f"process {n}: 0, because {n}' = {scales.kinematic[n]} holds exactly")
            continue
        s = scales.spread[n]
        if s <= 0:
            assumed.append(f"process {n}: 0, because {n} does not move in these recordings")
            continue
        low, high = LEAST * s / np.sqrt(scales.span), s / np.sqrt(FEW * scales.period)
        own_process[n] = (float(low), float(high))
        start[f"process {n}"] = float(np.sqrt(low * high) if high > low else low)
        made.add(f"process {n}")
        assumed.append(f"process {n}: between {low:.3g} and {high:.3g} in a second, from its spread of {s:.3g}")
    for n in states:
        if n in own_initial:
            continue
        level, why = _initial(n, scales, own_measurement)
        own_initial[n] = level
        assumed.append(f"initial {n}: {level:.3g}, {why}")
    return Proposal(Noise(own_process, own_measurement, own_initial), start, tuple(assumed), frozenset(made))


def _initial(name: str, scales: Scales, measurement: Mapping[str, Level]) -> tuple[float, str]:
    known = max(KNOWN * scales.spread[name], 1e-12)
    if scales.begin[name] == "parameter":
        return known, "because a parameter says where it begins"
    level = measurement.get(name)
    if level is not None:
        return FIRST * scales.residual[name] if scales.residual[
            name
        ] > 0 else known, "ten times the residual of its measurement"
    if scales.begin[name] == "measured":
        return max(FIRST * max(scales.residual.values()), known), "because it begins at a measurement"
    return known, "because the model says where it begins"


def _scatter(residuals: list[np.ndarray]) -> float:
    """Standard deviation of white noise behind residuals, by the middle of their second differences."""
    own = [_in_turn(r) for r in residuals]
    second = np.concatenate([r[2:] - 2 * r[1:-1] + r[:-2] for r in own]) if own else np.zeros(0)
    second = second[np.isfinite(second)]
    return float(np.median(np.abs(second)) / 0.6745 / DIFFERENCES) if len(second) else 0.0


def _in_turn(residual: np.ndarray) -> np.ndarray:
    """The residual (n,), or its measured samples alone where most stand between missing ones: a signal with times of
    its own."""
    there = np.isfinite(residual)
    return residual[there] if np.sum(there[1:] & there[:-1]) < 0.5 * there.sum() else residual


def _simulated(problem: Problem, values: Mapping[str, float]) -> tuple[list[StateSpace], dict[str, list[np.ndarray]]]:
    """Residuals (n, m) of every fitted recording, by a filter that believes nothing but the model."""
    noise = Noise({}, dict.fromkeys(problem.outputs, 1.0), dict.fromkeys(_states(problem), 0.0))
    names = [n for n, e in problem.experiments.items() if np.any(e.mask("fit"))]
    plants, found = [], {}
    for name in names:
        filter = ekf(problem, noise, at=values, recording=name)
        run = filter.run(fitted=True)
        plants.append(filter.plant)
        found[name] = [run.innovations, run.mean]
    return plants, found


def _over_records(problem: Problem, values: Mapping[str, float]):
    plants, found = _simulated(problem, values)
    t = [problem.experiments[n].recording.t[: len(found[n][0])] for n in found]
    return (
        plants[0],
        [f[0] for f in found.values()],
        [f[1] for f in found.values()],
        [np.median(np.diff(a)) for a in t],
        [np.ptp(a) for a in t],
    )


def _begin(problem: Problem, plant: StateSpace, values: Mapping[str, float]) -> dict[str, str]:
    vector = jnp.asarray(
        [values.get(n, 0.0) for n in problem.space.names] + [1.0] * (plant.space.dimension - problem.space.dimension)
    )
    drive = problem.predictor.drive(problem.experiments[str(plant.recording)])
    by_value = np.asarray(jacobian(lambda v: plant.first(v, drive), vector))
    seen = jnp.nan_to_num(jnp.stack([jnp.asarray(y) for y in drive.first_output]))
    by_output = np.asarray(jacobian(lambda y: plant.first(vector, drive._replace(first_output=tuple(y))), seen))
    kinds = np.where(
        np.any(by_output != 0, axis=1), "measured", np.where(np.any(by_value != 0, axis=1), "parameter", "model")
    )
    return dict(zip(plant.model.states, kinds.tolist(), strict=True))


def _kinematic(problem: Problem, plant: StateSpace, values: Mapping[str, float], states: np.ndarray) -> dict[str, str]:
    """States whose rate is another state, whatever the inputs, by name."""
    rng = np.random.default_rng(0)
    vector, names = plant.simulator.vector, list(plant.model.states)
    p = plant.simulator.positional(
        plant.space.tree(np.array([values[n] for n in problem.space.names]), plant.recording)
    )
    size = np.maximum(np.max(np.abs(states), axis=0), 1e-6)
    found: dict[str, str] = {}
    same = np.ones((len(names), len(names)), dtype=bool)
    for _ in range(3):
        x, u = (
            states[rng.integers(len(states))] + 0.1 * size * rng.standard_normal(len(names)),
            rng.standard_normal(len(vector.channels)),
        )
        rate = np.array([float(r) for r in vector.rate(tuple(x), tuple(u), p)])
        same &= np.isclose(rate[:, None], x[None, :], rtol=1e-12, atol=0.0)
    for i, n in enumerate(names):
        others = [j for j in np.flatnonzero(same[i]) if j != i]
        if others:
            found[n] = names[others[0]]
    return found
