"""Methods against each other on one problem: effect size with its interval, and rank tests corrected for their
number."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import scipy

from plantfit.findings.results.methods_compared import SIGNIFICANCE, PairInTime
from plantfit.study.comparing.statistics import NAN_INTERVAL, Interval

EFFECTS = ((0.06, "negligible"), (0.14, "small"), (0.21, "medium"))  # |A12 - 1/2| below which, Vargha and Delaney 2000
POWER = 0.8


def compare(costs: Mapping[str, Any]) -> list[PairInTime]:
    """All pairs of methods, each with costs (n,); failed runs (NaN) rank as worst. No empty ones."""
    ranked = {method: _failures_last(values) for method, values in costs.items() if np.size(values)}
    pairs = list(combinations(ranked, 2))
    p = [mann_whitney(ranked[a], ranked[b]) for a, b in pairs]
    return [
        PairInTime(
            first=a,
            second=b,
            a12=a12(ranked[a], ranked[b]),
            p=raw,
            p_holm=fixed,
            a12_interval=a12_interval(ranked[a], ranked[b]),
        )
        for (a, b), raw, fixed in zip(pairs, p, holm(p), strict=True)
    ]


def a12(x: Any, y: Any) -> float:
    """P(X > Y) + P(X = Y) / 2 over all pairs (Vargha and Delaney 2000, J. Educ. Behav. Stat. 25:101)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if not (x.size and y.size):
        return float("nan")
    return float(_placements(x, y).mean())


def a12_interval(x: Any, y: Any, level: float = 0.95) -> Interval:
    """Confidence interval of A12; NaN without runs, (0, 1) for a single run on a side.

    Variance from the placements of each run among the others (DeLong, DeLong and Clarke-Pearson 1988,
    Biometrics 44:837) on the logit scale, which holds for unequal spreads too. Where they have none (one method
    is ahead in every pair) the score interval of Newcombe 2006, Stat. Med. 25:559, method 5.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    m, n = x.size, y.size
    if not (m and n):
        return NAN_INTERVAL
    if min(m, n) < 2:
        return 0.0, 1.0
    of_x, of_y = _placements(x, y), _placements(y, x)
    effect = float(of_x.mean())
    variance = float(of_x.var(ddof=1) / m + of_y.var(ddof=1) / n)
    z = float(scipy.stats.norm.ppf(0.5 + level / 2))
    if not 0 < effect < 1 or variance == 0:
        return _score_interval(effect, m, n, z)
    half = z * np.sqrt(variance) / (effect * (1 - effect))
    low, high = scipy.special.expit(scipy.special.logit(effect) + np.array([-half, half]))
    return float(low), float(high)


def effect_word(effect: float) -> str:
    """How large an A12 is, in a word."""
    return next((word for edge, word in EFFECTS if abs(effect - 0.5) < edge), "large")


def detectable(m: int, n: int, pairs: int = 1) -> float:
    """A12 above 1/2 that m and n runs show with 80 % power at 5 % over `pairs` tests; 1 if none.

    Noether 1987, J. Am. Stat. Assoc. 82:645, at the strictest level of Holm's correction.
    """
    if m == 0 or n == 0:
        return 1.0
    share = m / (m + n)
    z = scipy.stats.norm.ppf(1 - SIGNIFICANCE / (2 * max(pairs, 1))) + scipy.stats.norm.ppf(POWER)
    return float(min(1.0, 0.5 + z / np.sqrt(12 * share * (1 - share) * (m + n))))


def holm(p_values: Any) -> list[float]:
    """Holm's step-down correction (Holm 1979, Scand. J. Stat. 6:65), in the order given."""
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return corrected.tolist()


def mann_whitney(x: np.ndarray, y: np.ndarray) -> float:
    """Two-sided Mann-Whitney p value of (m,) and (n,), infinities ranking last; 1 if all are equal."""
    both = np.concatenate([x, y])
    if np.all(both == both[0]):
        return 1.0  # nothing but ties: no evidence of a difference
    # ranks in place of values, because scipy takes an infinite cost for a missing one in no policy
    ranks = scipy.stats.rankdata(both)
    return float(scipy.stats.mannwhitneyu(ranks[: len(x)], ranks[len(x) :], alternative="two-sided").pvalue)


def levels(costs: Mapping[str, Any], tolerance: float, floor: float = 0.0) -> dict[str, np.ndarray]:
    """Costs (n,) of every method as whole numbers, equal where costs differ by rounding only.

    A level holds the costs up to `tolerance` * |cost| + `floor` above its lowest; NaN and inf share the last.
    """
    every = np.concatenate([_failures_last(values) for values in costs.values()] or [np.empty(0)])
    order = np.argsort(every, kind="stable")
    level, lowest, place = -1, -np.inf, np.empty(len(every))
    for k in order:
        cost = every[k]
        if level < 0 or (cost != lowest and not cost <= lowest + tolerance * abs(lowest) + floor):
            level, lowest = level + 1, cost
        place[k] = level
    return _split(place, costs)


def hitting_order(to_target: Mapping[str, Any], costs: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Ranks (n,) of every method's runs: by time to the target, misses behind all hits by their final cost.

    `to_target` (n,) is inf where a run missed.
    """
    times = np.concatenate([np.asarray(v, dtype=float) for v in to_target.values()] or [np.empty(0)])
    final = np.concatenate([_failures_last(costs[m]) for m in to_target] or [np.empty(0)])
    missed = ~np.isfinite(times)
    rank = np.empty(len(times))
    rank[~missed] = scipy.stats.rankdata(times[~missed])
    rank[missed] = np.sum(~missed) + scipy.stats.rankdata(final[missed])
    return _split(rank, to_target)


def _split(values: np.ndarray, sizes: Mapping[str, Any]) -> dict[str, np.ndarray]:
    ends = np.cumsum([np.size(v) for v in sizes.values()])[:-1]
    return dict(zip(sizes, np.split(values, ends), strict=True)) if sizes else {}


def _placements(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Share of `y` (n,) that lies below each of `x` (m,), equal ones counting half."""
    ordered = np.sort(y)
    return (np.searchsorted(ordered, x, side="left") + np.searchsorted(ordered, x, side="right")) / (2 * len(y))


def _score_interval(effect: float, m: int, n: int, z: float) -> Interval:
    half = (m + n) / 2 - 1

    def outside(a: float) -> float:
        variance = a * (1 - a) * (1 + half * ((1 - a) / (2 - a) + a / (1 + a))) / (m * n)
        return (a - effect) ** 2 - z * z * variance

    small = 1e-12  # the estimate itself is a root where it is 0 or 1
    low = 0.0 if effect <= 0 else float(scipy.optimize.brentq(outside, 0.0, effect - small))
    high = 1.0 if effect >= 1 else float(scipy.optimize.brentq(outside, effect + small, 1.0))
    return low, high


def _failures_last(costs: Any) -> np.ndarray:
    values = np.asarray(costs, dtype=float).ravel()
    return np.where(np.isnan(values), np.inf, values)
