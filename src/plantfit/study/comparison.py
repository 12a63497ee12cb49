"""Methods against each other: effect size and rank tests, corrected for their number."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class Comparison:
    """Methods `first` and `second`: `a12` is the probability that first costs more than second.

    0.5 is a draw; below 0.5 the first is better. `p` is the two-sided Mann-Whitney p value and
    `p_holm` the same after Holm's correction for all pairs.
    """

    first: str
    second: str
    a12: float
    p: float
    p_holm: float


def compare(costs: Mapping[str, Any]) -> list[Comparison]:
    """All pairs of methods, each with costs (n,); failed runs (NaN) rank as worst. No empty ones."""
    ranked = {method: _failures_last(values) for method, values in costs.items() if np.size(values)}
    pairs = list(combinations(ranked, 2))
    p = [_mann_whitney(ranked[a], ranked[b]) for a, b in pairs]
    return [Comparison(a, b, a12(ranked[a], ranked[b]), raw, fixed) for (a, b), raw, fixed in zip(pairs, p, holm(p), strict=True)]


def a12(x: Any, y: Any) -> float:
    """P(X > Y) + P(X = Y) / 2 over all pairs (Vargha and Delaney 2000, J. Educ. Behav. Stat. 25:101)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if not (x.size and y.size):
        return float("nan")
    more, equal = x[:, None] > y[None, :], x[:, None] == y[None, :]
    return float(np.mean(more + 0.5 * equal))


def holm(p_values: Any) -> list[float]:
    """Holm's step-down correction (Holm 1979, Scand. J. Stat. 6:65), in the order given."""
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return corrected.tolist()


def _failures_last(costs: Any) -> np.ndarray:
    values = np.asarray(costs, dtype=float).ravel()
    return np.where(np.isnan(values), np.inf, values)


def _mann_whitney(x: np.ndarray, y: np.ndarray) -> float:
    both = np.concatenate([x, y])
    if np.all(both == both[0]):
        return 1.0  # nothing but ties: no evidence of a difference
    # ranks in place of values, because scipy takes an infinite cost for a missing one in no policy
    ranks = stats.rankdata(both)
    return float(stats.mannwhitneyu(ranks[: len(x)], ranks[len(x) :], alternative="two-sided").pvalue)
