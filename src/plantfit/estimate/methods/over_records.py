"""A filter over several recordings in turn: what one leaves known of the parameters is where the next begins."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.beliefs import FilterRun
from plantfit.estimate.filters.filter import Filter
from plantfit.estimate.filters.noise import Noise
from plantfit.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of one filter over the fitted recordings by name, the parameters at their end, and 95 % intervals by name.

    A parameter of one recording has the value at the end of that recording.
    """

    runs: Mapping[str, FilterRun]
    estimate: Estimate
    interval: Mapping[str, tuple[float, float]]

    @property
    def last(self) -> FilterRun:
        """The run over the last recording."""
        return list(self.runs.values())[-1]


def over_recordings(
    kind: Callable[..., Filter],
    problem: Problem,
    noise: Noise,
    parameters: Sequence[str],
    *,
    at: Mapping[str, float],
    prior: Mapping[str, float],
    drift: Mapping[str, float],
    made: dict[str, Filter] | None = None,
) -> Runs:
    """`kind` (`ekf`, `ukf` with its settings) over the fitted part of every recording in order; arguments as in `ekf`.

    `made` keeps the compiled filters by recording for another call that differs in `at` and `prior` alone. States begin
    anew in every recording; parameters that recordings share go on with mean and covariance. Raises SimulationError
    where the filter diverges.
    """
    of = {c.name: c.recording for c in problem.space.coordinates}
    runs: dict[str, FilterRun] = {}
    names: list[str] = []
    values: dict[str, float] = {}
    interval: dict[str, tuple[float, float]] = {}
    known: tuple[list[str], np.ndarray, np.ndarray] | None = None  # shared names, their states (k,), covariance (k, k)
    covariance: dict[tuple[str, str], float] = {}
    for recording in [n for n, e in problem.experiments.items() if np.any(e.mask("fit"))]:
        own = [n for n in parameters if of[n] in (None, recording)]
        own_prior, own_drift = ({n: v for n, v in given.items() if n in own} for given in (prior, drift))
        if made is not None and recording in made:
            filter = made[recording]
            filter.begin(at, own_prior)
        else:
            filter = kind(problem, noise, own, at=at, prior=own_prior, drift=own_drift, recording=recording)
        if made is not None:
            made[recording] = filter
        order = list(_joint(filter))
        if known is not None:
            _begin(filter, order, *known)
        run = filter.run(fitted=True)
        runs[recording] = run
        estimate, n = run.estimate, run.plant.states
        for i, a in enumerate(order):
            values[a] = float(estimate.values[i])
            interval[a] = run.interval[a]
            names += [a] if a not in names else []
            covariance |= {(a, b): float(estimate.covariance[i, j]) for j, b in enumerate(order)}
        shared = [i for i, a in enumerate(order) if of[a] is None]
        at_states = run.covariance[-1, n:, n:][np.ix_(shared, shared)]
        known = [order[i] for i in shared], run.mean[-1, n:][shared], at_states
    matrix = np.array([[covariance.get((a, b), 0.0) for b in names] for a in names]).reshape(len(names), len(names))
    return Runs(runs, Estimate(tuple(names), np.array([values[n] for n in names]), matrix), interval)


def _joint(filter: Filter) -> tuple[str, ...]:
    return tuple(filter.plant.space.names[i] for i in filter.plant.joint)


def _begin(
    filter: Filter, order: Sequence[str], names: Sequence[str], mean: np.ndarray, covariance: np.ndarray
) -> None:
    """Let a filter begin at states of shared parameters with their covariance."""
    if not len(names):
        return
    places, n = [order.index(a) for a in names], filter.plant.states
    filter.own = np.array(filter.own, dtype=float)
    filter.own[places] = mean
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    w, v = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = np.zeros_like(filter.root)
    root[:] = filter.root
    rows = np.array(places) + n
    root[rows] = 0.0
    root[np.ix_(rows, rows)] = scale[:, None] * v * np.sqrt(np.maximum(w, 0.0))
    # the filter keeps triangular roots
    filter.root = np.asarray(np.linalg.qr(root.T, mode="r")).T
