"""How runs went over time: targets reached, medians inside their quartiles, and where methods change places."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from plantfit.findings.results.methods_compared import Lead
from plantfit.study.comparing.pairwise import a12
from plantfit.study.store.records import RunRecord

GRID = 200  # points of a common logarithmic grid
NOTICEABLE = 0.06  # |A12 - 1/2| from which a method is ahead (Vargha and Delaney's small effect)

Clock = Callable[[RunRecord], np.ndarray]


def by_evaluations(run: RunRecord) -> np.ndarray:
    """Evaluations (k,) at the points of a run's history."""
    return np.asarray(run.history_evaluations, dtype=float)


def by_seconds(run: RunRecord) -> np.ndarray:
    """Seconds (k,) at the points of a run's history: the run's seconds, shared evenly over its evaluations."""
    return by_evaluations(run) * (run.seconds / run.evaluations if run.evaluations else np.nan)


def hitting_times(runs: Sequence[RunRecord], targets: Any, clock: Clock = by_evaluations) -> np.ndarray:
    """Time (n, t) at which each run first was at or below each target; inf where it never was."""
    wanted = np.asarray(targets, dtype=float)
    found = np.full((len(runs), len(wanted)), np.inf)
    for k, r in enumerate(runs):
        times = clock(r)
        if len(times):
            cost = np.minimum.accumulate(np.where(np.isnan(r.history_cost), np.inf, r.history_cost))
            # costs fall, so that their negatives are sorted; place = first one with cost <= target
            place = np.searchsorted(-cost, -wanted, side="left")
            hit = place < len(cost)
            found[k, hit] = times[place[hit]]
    return found


def ecdf(times: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Share (g,) of all hitting times (any shape, inf where missed) that are at most `at` (g,)."""
    every = np.sort(np.ravel(times))
    return np.searchsorted(every, at, side="right") / max(len(every), 1)


def data_profile(problems: Iterable[tuple[np.ndarray, int]], at: np.ndarray) -> np.ndarray:
    """Share (g,) of (problem, target, run) reached within `at` (g,) times d + 1 evaluations.

    `problems` are hitting times and the dimension d of each (More and Wild 2009, SIAM J. Optim. 20:172).
    """
    scaled = [np.ravel(times) / (dimension + 1) for times, dimension in problems]
    return ecdf(np.concatenate(scaled or [np.empty(0)]), at)


def grid_of(runs: Sequence[RunRecord], clock: Clock = by_evaluations, points: int = GRID) -> np.ndarray:
    """Common logarithmic times (<= points,), from the first record of any run to the last of any."""
    clocks = [c for r in runs if len(c := clock(r))]
    first = [c[c > 0][0] for c in clocks if np.any(c > 0)]
    if not first:
        return np.empty(0)
    low, high = float(np.min(first)), float(np.max([c[-1] for c in clocks]))
    return np.geomspace(low, high, points) if high > low else np.array([low])


def best_costs(runs: Sequence[RunRecord], grid: np.ndarray, clock: Clock = by_evaluations) -> np.ndarray:
    """Best cost (n, g) of each run at the times of `grid`: inf before its first one, held after its last."""
    found = np.full((len(runs), len(grid)), np.inf)
    slack = grid * (1 + 1e-12)  # the last point of a geometric grid may fall short by rounding
    for k, r in enumerate(runs):
        times = clock(r)
        if len(times):
            place = np.searchsorted(times, slack, side="right") - 1
            cost = np.where(np.isnan(r.history_cost), np.inf, r.history_cost)
            found[k] = np.where(place < 0, np.inf, cost[np.maximum(place, 0)])
    return found


def quartiles(costs: np.ndarray) -> np.ndarray:
    """Lower quartile, median and upper quartile (3, g) of costs (n, g) that may be inf, each a cost that occurs or a
    mean of two."""
    with np.errstate(invalid="ignore"):
        low, high = (
            np.quantile(costs, 0.25, axis=0, method="inverted_cdf"),
            np.quantile(costs, 0.75, axis=0, method="inverted_cdf"),
        )
        return np.stack([low, np.median(costs, axis=0), high])


def leads(first: tuple[str, np.ndarray], second: tuple[str, np.ndarray], grid: np.ndarray) -> list[Lead]:
    """Who of two methods with best costs (n, g), (m, g) is ahead from when on; stretches without a lead belong to the
    last leader.

    Few runs must differ by more: at least 1.5 standard errors of an A12 of equal methods. A change is dated where the
    medians cross.
    """
    (a, x), (b, y) = first, second
    m, n = len(x), len(y)
    least = max(NOTICEABLE, 1.5 * np.sqrt((m + n + 1) / (12 * m * n)))
    effect = np.array([a12(x[:, k], y[:, k]) for k in range(len(grid))])
    sign = np.where(effect <= 0.5 - least, -1, np.where(effect >= 0.5 + least, 1, 0))
    with np.errstate(invalid="ignore"):
        ahead = np.nan_to_num(np.sign(np.median(x, axis=0) - np.median(y, axis=0)))
    found: list[Lead] = []
    held, since = 0, 0
    for k in np.flatnonzero(sign):
        if sign[k] != held:
            crossed = np.flatnonzero(ahead[since : k + 1] == sign[k]) if held else np.array([], dtype=int)
            place = since + int(crossed[0]) if len(crossed) else int(k)
            found.append(Lead(method=a if sign[k] < 0 else b, start=float(grid[place])))
        held, since = sign[k], int(k)
    return found
