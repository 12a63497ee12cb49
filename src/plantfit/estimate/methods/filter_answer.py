"""Maximum likelihood or a Kalman filter as the answer of a problem, in place of that of least squares."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, SimulationError, SpaceError
from plantfit.estimate.comparison import SURE, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.beliefs import FilterRun
from plantfit.estimate.filters.filter import Filter
from plantfit.estimate.filters.kalman import ekf, ukf
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.agreement import Estimated
from plantfit.estimate.methods.by_filters import Wishes, by_filters
from plantfit.estimate.methods.estimates_record import LIKELIHOOD, filter_findings
from plantfit.estimate.methods.filtered import FILTERS
from plantfit.estimate.methods.levels import Asked
from plantfit.estimate.methods.over_records import over_recordings
from plantfit.findings.filtered import FilteredAnswer
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.problem.problem import Problem

SETTLED = 1.5  # times the median of a state's standard deviation, from which on a filter has found the states


def filter_answer(
    problem: Problem, least: Estimate, wished: Wishes, told: Asked, say: Callable[[str], None] = lambda _: None
) -> Filtered | str:
    """The answer by the `estimator` of a final problem, from that of least squares, or a clause that says what stands
    against it.

    `wished.methods` is that estimator alone. Levels of noise that nobody gave are found by maximum likelihood.
    """
    estimator = str(problem.estimator)
    method = FILTERS.get(estimator, LIKELIHOOD)
    try:
        found = by_filters(problem, least, wished, told, say)
    except (SearchError, SimulationError, SpaceError) as error:
        return _clause(error)
    estimated = found.estimates[method]
    if why := _objection(problem, estimated, method):
        return why
    estimate, interval = estimated
    order = [estimate.names.index(n) for n in problem.space.names]
    values, named = estimate.values[order], estimate.named
    kind: Callable[..., Filter] = partial(ukf, kappa=wished.kappa) if estimator == "ukf" else ekf
    try:
        runs = over_recordings(kind, found.problem, found.noise, (), at=named, prior={}, drift={})
    except SimulationError as error:
        return _clause(error)
    test = compare_estimates(Estimate(problem.space.names, values, estimate.covariance[np.ix_(order, order)]), least)
    record = FilteredAnswer(
        estimator=estimator,  # pyrefly: ignore[bad-argument-type]
        noise=list(found.levels),
        filter=filter_findings("ukf" if estimator == "ukf" else "ekf", runs),
        p=test.p_value,
        moved=test.names[int(np.argmax(test.chi_squared))],
        differs=test.p_value < SURE,
        assumed=list(found.assumed),
    )
    return Filtered(
        np.asarray(problem.space.cube(problem.space.vector(named))),
        values,
        estimate.covariance[np.ix_(order, order)],
        {n: interval[n] for n in problem.space.names},
        _ahead(kind, found.problem, found.noise, named),
        record.plain(),
    )


def _clause(error: Exception) -> str:
    said = str(error).removesuffix(".")
    return f"{said[:1].lower()}{said[1:]}"


def _objection(problem: Problem, estimated: Estimated, method: str) -> str | None:
    """Why an estimate is not taken, as a clause."""
    estimate, interval = estimated
    for name in problem.space.names:
        if name not in estimate.names:
            return f"{name} is a dead time, which is no state of a filter; {LIKELIHOOD} finds it"
        if None in interval[name]:
            return f"{method} holds {name} at a bound of its range"
    if not (np.all(np.isfinite(estimate.covariance)) and np.all(np.diag(estimate.covariance) > 0.0)):
        return f"{method} gives no standard errors"
    return None


def _ahead(
    kind: Callable[..., Filter], problem: Problem, noise: Noise, values: Mapping[str, float]
) -> dict[str, dict[str, np.ndarray]]:
    """Outputs (n,) foretold one sample ahead over whole recordings, from where the filter has found the states."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for name in problem.experiments:
        with suppress(SimulationError):
            run = kind(problem, noise, (), at=values, recording=name).run()
            told = run.y - run.innovations
            told[: _settled(run)] = np.nan
            count = len(problem.experiments[name].recording)
            found[name] = {o: _padded(told[:, i], count) for i, o in enumerate(run.plant.model.outputs)}
    return found


def _settled(run: FilterRun) -> int:
    """How many samples a filter takes to find the states."""
    spread: Any = np.sqrt(np.sum(run.root**2, axis=2))
    near = np.all(spread <= SETTLED * np.median(spread, axis=0), axis=1)
    return int(np.argmax(near)) + 1 if near.any() else 1


def _padded(values: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([values, np.full(count - len(values), np.nan)])


__all__ = ["filter_answer"]
