"""Methods over several problems: average ranks, their tests, and effects with intervals.

The replicates are the problems: any number of runs on one problem is one line of evidence here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from plantfit.study.comparing.pairwise import holm
from plantfit.study.comparing.statistics import Interval


@dataclass(frozen=True)
class Friedman:
    """Ranks of k methods over N problems; rank 1 is the lowest cost.

    `p` belongs to `f` (Iman and Davenport), which is less timid than `chi_square` with `p_chi_square`. `best` is the
    method with the lowest mean rank; `z`, `p_post_hoc` and `p_holm` (k,) compare every method with it, NaN for itself.
    """

    methods: tuple[str, ...]
    problems: int
    mean_ranks: tuple[float, ...]
    chi_square: float
    p_chi_square: float
    f: float
    p: float
    best: str
    z: tuple[float, ...]
    p_post_hoc: tuple[float, ...]
    p_holm: tuple[float, ...]


def friedman(methods: Sequence[str], costs: np.ndarray) -> Friedman:
    """Friedman's test with the statistic of Iman and Davenport 1980 (Comm. Stat. A 9:571) on `costs` (N, k), k >= 2.

    Post hoc z = (R_i - R_best) / sqrt(k (k + 1) / 6 N) with Holm's correction (Demsar 2006, J. Mach. Learn. Res. 7:1).
    """
    problems, k = np.shape(costs)
    ranks = scipy.stats.rankdata(np.where(np.isnan(costs), np.inf, costs), axis=1)
    mean = ranks.mean(axis=0)
    chi = _chi_square(ranks)
    spare = problems * (k - 1) - chi
    f = np.inf if spare <= 1e-12 * problems else (problems - 1) * chi / spare
    p = float(scipy.stats.f.sf(f, k - 1, (k - 1) * (problems - 1))) if problems > 1 else 1.0
    best = int(np.argmin(mean))
    z = (mean - mean[best]) / np.sqrt(k * (k + 1) / (6 * problems))
    others = [j for j in range(k) if j != best]
    raw = np.full(k, np.nan)
    raw[others] = 2 * scipy.stats.norm.sf(np.abs(z[others]))
    fixed = np.full(k, np.nan)
    fixed[others] = holm(raw[others])
    z[best] = np.nan
    return Friedman(
        tuple(methods), problems, tuple(mean.tolist()), chi, float(scipy.stats.chi2.sf(chi, k - 1)), float(f), p,
        methods[best], tuple(z.tolist()), tuple(raw.tolist()), tuple(fixed.tolist()),
    )  # fmt: skip


def _chi_square(ranks: np.ndarray) -> float:
    """Friedman's statistic, corrected for ties within problems; 0 if all ranks are tied."""
    problems, k = ranks.shape
    centre = (k + 1) / 2
    spread = np.sum((ranks - centre) ** 2)
    return float((k - 1) * np.sum((ranks.sum(axis=0) - problems * centre) ** 2) / spread) if spread else 0.0


def signed_rank(first: np.ndarray, second: np.ndarray) -> float:
    """Wilcoxon's two-sided signed-rank p value of two methods' medians (N,), one of each per problem; 1 if all are
    equal.

    Ratios are compared where all medians are above zero, so that no problem outweighs the others by its units.
    """
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    positive = np.all(np.isfinite([first, second])) and min(first.min(), second.min()) > 0
    difference = np.log(first / second) if positive else first - second
    difference = difference[~np.isnan(difference)]
    return float(np.asarray(scipy.stats.wilcoxon(difference))[1]) if np.any(difference) else 1.0


def smallest_p(problems: int) -> float:
    """The smallest p value that a signed-rank test over so many problems can give."""
    return min(1.0, 2.0 ** (1 - problems))


def resampled_a12(x: np.ndarray, y: np.ndarray, *, rng: np.random.Generator, resamples: int) -> np.ndarray:
    """A12 (resamples,) of runs drawn with replacement from x (m,) and y (n,)."""
    wins = ((x[:, None] > y) + 0.5 * (x[:, None] == y)).astype(np.float32)
    found = np.empty(resamples)
    for start in range(0, resamples, 1000):
        size = min(1000, resamples - start)
        of_x = rng.multinomial(len(x), np.full(len(x), 1 / len(x)), size).astype(np.float32)
        of_y = rng.multinomial(len(y), np.full(len(y), 1 / len(y)), size)
        found[start : start + size] = np.sum((of_x @ wins) * of_y, axis=1) / (len(x) * len(y))
    return found


def hierarchical_interval(replicates: np.ndarray, *, rng: np.random.Generator, level: float = 0.95) -> Interval:
    """Interval of the mean over problems from `replicates` (N, b): each of N problems' runs resampled b times.

    Resamples the problems, then takes for each a resample of its runs, so that both spreads count.
    """
    problems, b = replicates.shape
    chosen = rng.integers(0, problems, (problems, b))
    means = replicates[chosen, np.arange(b)].mean(axis=0)
    low, high = np.quantile(means, [0.5 - level / 2, 0.5 + level / 2])
    return float(low), float(high)
