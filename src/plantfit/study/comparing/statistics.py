"""Runs of one method in numbers: location, spread, intervals, success and expected running time."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy

from plantfit.findings.results.methods_compared import RunsSummary
from plantfit.study.store.records import RunRecord

Interval = tuple[float, float]

NAN_INTERVAL = (float("nan"), float("nan"))


def costs_by_method(runs: Iterable[RunRecord]) -> dict[str, np.ndarray]:
    """Final costs (n,) of every method, in the order of the runs."""
    found: dict[str, list[float]] = {}
    for r in runs:
        found.setdefault(r.method, []).append(r.cost)
    return {method: np.array(costs, dtype=float) for method, costs in found.items()}


def summarise(costs: Any, *, seed: int = 0, resamples: int = 9999) -> RunsSummary:
    """Summary of costs (n,); `seed` drives the bootstrap of `resamples`. All numbers are NaN without a finite cost."""
    every = np.asarray(costs, dtype=float).ravel()
    values = every[np.isfinite(every)]
    n = len(values)
    if n == 0:
        nan = float("nan")
        return RunsSummary(
            n=0, failed=len(every), minimum=nan, maximum=nan, median=nan, mean=nan, std=nan, sem=nan,
            normal_interval=NAN_INTERVAL,
            t_interval=NAN_INTERVAL, bootstrap_interval=NAN_INTERVAL,
        )  # fmt: skip
    std = float(np.std(values, ddof=1)) if n > 1 else float("nan")
    return RunsSummary(
        n=n,
        failed=len(every) - n,
        minimum=float(values.min()),
        maximum=float(values.max()),
        median=float(np.median(values)),
        mean=float(values.mean()),
        std=std,
        sem=std / float(np.sqrt(n)),
        normal_interval=normal_interval(values),
        t_interval=t_interval(values),
        bootstrap_interval=bootstrap_interval(values, seed=seed, resamples=resamples),
    )


def normal_interval(values: Any, level: float = 0.95) -> Interval:
    """Confidence interval of the mean, mean +- z(level) std / sqrt(n), as papers print it; NaN for n < 2, too short
    for few runs."""
    return _around_mean(values, float(scipy.stats.norm.ppf(0.5 + level / 2)))


def t_interval(values: Any, level: float = 0.95) -> Interval:
    """Confidence interval of the mean, mean +- t(level, n - 1) std / sqrt(n); NaN for n < 2."""
    return _around_mean(values, float(scipy.stats.t.ppf(0.5 + level / 2, max(np.size(values) - 1, 1))))


def _around_mean(values: Any, quantile: float) -> Interval:
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        return NAN_INTERVAL
    half = quantile * np.std(values, ddof=1) / np.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


def bootstrap_interval(
    values: Any, *, seed: int = 0, level: float = 0.95, resamples: int = 9999, statistic: Callable[..., Any] = np.mean
) -> Interval:
    """Bias-corrected and accelerated bootstrap interval (Efron 1987) of a statistic; NaN for n < 2."""
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        return NAN_INTERVAL
    if np.all(values == values[0]):
        return float(values[0]), float(values[0])
    result = scipy.stats.bootstrap(
        (values,),
        statistic,
        confidence_level=level,
        n_resamples=resamples,
        method="BCa",
        rng=np.random.default_rng(seed),
        batch=999,
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def ratio_interval(x: Any, y: Any, *, seed: int, resamples: int = 9999) -> Interval:
    """95 % percentile bootstrap interval of median(x) / median(y) for costs above zero (n,), (m,).

    Percentiles and not their bias-corrected form, which is undefined for medians of many ties.
    """

    def ratio(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.median(a, axis=axis) / np.median(b, axis=axis)

    found = scipy.stats.bootstrap(
        (x, y),
        ratio,
        n_resamples=resamples,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(seed),
        batch=999,
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def wilson_interval(successes: int, n: int, level: float = 0.95) -> Interval:
    """Score interval of a proportion (Wilson 1927, J. Am. Stat. Assoc. 22:209); (0, 1) for n = 0."""
    if n == 0:
        return 0.0, 1.0
    z, p = scipy.stats.norm.ppf(0.5 + level / 2), successes / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    # the ends are exact at 0 and n successes, where rounding would leave 1e-17
    low = 0.0 if successes == 0 else float(centre - half)
    high = 1.0 if successes == n else float(centre + half)
    return low, high


def success_rate(costs: Any, target: float, level: float = 0.95) -> tuple[float, Interval]:
    """Share of runs with cost <= target, NaN counting as a miss, and its Wilson interval."""
    costs = np.asarray(costs, dtype=float)
    hits = int(np.sum(costs <= target))
    return (hits / len(costs) if len(costs) else float("nan")), wilson_interval(hits, len(costs), level)


def evaluations_to_target(history_evaluations: Any, history_cost: Any, target: float) -> float:
    """Evaluations spent when the best cost first was <= target; inf if it never was."""
    reached = np.flatnonzero(np.asarray(history_cost, dtype=float) <= target)
    return float(np.asarray(history_evaluations, dtype=float)[reached[0]]) if len(reached) else float("inf")


def expected_running_time(spent: Any, to_target: Any) -> float:
    """Expected evaluations until the target with restarts (Hansen et al. 2010, ERT).

    Evaluations until the target of the runs that reached it, plus all evaluations of the others,
    over the number of runs that reached it; inf if none did. `to_target` is inf where missed.
    """
    spent_, reached = np.asarray(spent, dtype=float), np.asarray(to_target, dtype=float)
    hits = np.isfinite(reached)
    if not hits.any():
        return float("inf")
    return float((reached[hits].sum() + spent_[~hits].sum()) / hits.sum())


def running_times(spent: Any, to_target: Any, *, seed: int = 0, resamples: int = 2000) -> np.ndarray:
    """Expected running times (resamples,) of bootstrapped simulated restarts; all inf if no run reached the target.

    A simulated restart draws runs with replacement until one reached the target and adds up what they spent (Hansen,
    Auger, Ros, Mersmann, Tusar and Brockhoff 2021, Optim. Methods Softw. 36:114). Each resample is the mean of as many
    restarts as there are hits in the sample.
    """
    spent_, reached = np.asarray(spent, dtype=float), np.asarray(to_target, dtype=float)
    hits = np.isfinite(reached)
    k, n = int(hits.sum()), len(reached)
    if k == 0:
        return np.full(resamples, np.inf)
    rng = np.random.default_rng(seed)
    total = rng.choice(reached[hits], (resamples, k)).sum(axis=1)
    if k < n:
        # failures before the k-th hit, when each draw hits with probability k / n
        failures = rng.negative_binomial(k, k / n, resamples)
        owner = np.repeat(np.arange(resamples), failures)
        total += np.bincount(owner, weights=rng.choice(spent_[~hits], len(owner)), minlength=resamples)
    return total / k


def running_time_interval(spent: Any, to_target: Any, *, seed: int = 0, resamples: int = 2000) -> Interval:
    """95 % interval of the expected running time from simulated restarts.

    Without a hit it reaches from the time that the upper Wilson limit of the success rate would mean to infinity.
    """
    n = len(spent)
    if n == 0:
        return NAN_INTERVAL
    if not np.isfinite(np.asarray(to_target, dtype=float)).any():
        most = wilson_interval(0, n)[1]
        return float(np.mean(spent)) * (1 - most) / most, float("inf")
    low, high = np.quantile(running_times(spent, to_target, seed=seed, resamples=resamples), [0.025, 0.975])
    return float(low), float(high)
