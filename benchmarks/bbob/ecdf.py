"""How good runs are: area under the ECDF of running times, expected running time, tests over functions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

import plantfit.runtime  # noqa: F401
from plantfit.study.comparing.pairwise import a12, holm
from plantfit.study.comparing.statistics import expected_running_time

DECADES = 3.0  # evaluations / d from 1 to 1000


def solved_share(hits: Any, dimension: int, per_dimension: Any) -> np.ndarray:
    """Share of (run, target) pairs with hits (k, t) at most per_dimension * d evaluations, for each of per_dimension
    (n,)."""
    times = np.sort(np.asarray(hits, dtype=float).ravel()) / dimension
    return np.searchsorted(times, np.asarray(per_dimension, dtype=float), side="right") / len(times)


def areas(hits: Any, dimension: int) -> np.ndarray:
    """Area (k,) under each run's ECDF over log10(evaluations / d) from 0 to 3, divided by 3.

    A run's ECDF is the share of its targets reached; a target reached at T evaluations adds (3 - log10(T / d)) / 3,
    held to 0..1, so that 1 means every target within d evaluations and 0 none within 1000 d.
    """
    times = np.maximum(np.asarray(hits, dtype=float) / dimension, 1.0)
    with np.errstate(divide="ignore"):
        return np.mean(np.clip((DECADES - np.log10(times)) / DECADES, 0.0, 1.0), axis=-1)


def shares(hits: Any) -> np.ndarray:
    """Share (k,) of its targets that each run had reached by its end, from hits (k, t)."""
    return np.mean(np.isfinite(np.asarray(hits, dtype=float)), axis=-1)


def running_times(hits: Any, spent: Any) -> np.ndarray:
    """Expected running time (t,) of every target from hits (k, t) and evaluations spent (k,)."""
    return np.array(
        [expected_running_time(np.asarray(spent, dtype=float), column) for column in np.asarray(hits, dtype=float).T]
    )


@dataclass(frozen=True)
class Difference:
    """Method against reference over functions: means of the areas, wins and losses by function, Wilcoxon's
    signed-rank p value, the same after Holm's correction, and the effect size.

    `effect` is P(area > reference's) + P(equal) / 2 over pairs of runs on the same function (Vargha and Delaney's A12),
    averaged over functions: 0.5 is a draw, above it the method is better.
    """

    method: str
    reference: str
    area: float
    reference_area: float
    better: int
    worse: int
    p: float
    p_holm: float
    effect: float


def signed_rank(first: Any, second: Any) -> float:
    """Two-sided p value of Wilcoxon's signed-rank test; 1 when nothing differs."""
    difference = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    if not np.any(difference):
        return 1.0
    answer: Any = stats.wilcoxon(difference, zero_method="pratt")
    return float(answer.pvalue)


def differences(areas_of: Mapping[str, Mapping[int, np.ndarray]], pairs: Sequence[tuple[str, str]]) -> list[Difference]:
    """Compare pairs (method, reference) over the functions both have; `areas_of[method][function]` is (runs,).

    Replicates are functions, not runs: the test sees one mean area per function. Holm's correction covers the pairs
    given.
    """
    found = []
    for method, reference in pairs:
        ours, theirs = areas_of[method], areas_of[reference]
        functions = sorted(set(ours) & set(theirs))
        mine, other = (np.array([np.mean(a[f]) for f in functions]) for a in (ours, theirs))
        effect = float(np.mean([a12(ours[f], theirs[f]) for f in functions]))
        found.append((method, reference, mine, other, signed_rank(mine, other), effect))
    corrected = holm([row[4] for row in found])
    return [
        Difference(method, reference, float(mine.mean()), float(other.mean()), int(np.sum(mine > other)),
                   int(np.sum(mine < other)),
                   p, fixed, effect)
        for (method, reference, mine, other, p, effect), fixed in zip(found, corrected, strict=True)
    ]  # fmt: skip
