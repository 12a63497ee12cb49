"""Races: candidates meet on the same seeds, block by block, and those that are surely worse leave early.

F-Race: Birattari, Stuetzle, Paquete and Varrentrapp 2002, GECCO, 11-18; with the best so far in every race as in
irace: Lopez-Ibanez, Dubois-Lacoste, Perez Caceres, Birattari and Stuetzle 2016, Oper. Res. Perspect. 3:43.
"""

from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

import numpy as np
import scipy

LEVEL = 0.05

Key = TypeVar("Key", bound=Hashable)


def blocks(runs: int) -> list[int]:
    """Seeds that every survivor has met after each block: 3, 5, 8, 13, ... and all at last."""
    ends, step = [3, 5], (3, 5)
    while ends[-1] < runs:
        step = step[1], sum(step)
        ends.append(step[1])
    return [*(n for n in ends if n < runs), runs]


def race(
    candidates: Sequence[Key],
    scores: dict[Key, list[float]],
    best: Key | None,
    measure: Callable[[list[Key], int], None],
    runs: int,
) -> set[Key]:
    """Race candidates, and the best so far, over `runs` seeds; the candidates that were dropped.

    `measure(keys, n)` brings scores[key] to the first n seeds. A failed run has the score inf.
    """
    alive, dropped = list(dict.fromkeys(k for k in candidates if k != best)), set()
    for upto in blocks(runs):
        measure(alive, upto)
        field = [*alive, *([best] if best is not None else [])]
        worse = surely_worse(np.array([scores[k][:upto] for k in field]))
        gone = {k for k, is_worse in zip(field, worse, strict=True) if is_worse and k != best}
        dropped |= gone
        alive = [k for k in alive if k not in gone]
        if not alive:
            break
    return dropped


def surely_worse(scores: Any, level: float = LEVEL) -> np.ndarray:
    """Which rows of scores (candidates, seeds) are worse than the best row, as booleans (candidates,).

    Three and more: Friedman's test, then t tests of rank sums against the lowest (Conover 1999, Practical
    Nonparametric Statistics, 3rd ed., 5.8). Two: Wilcoxon's signed ranks, one-sided, on the ranks of all scores.
    Only order counts, so that any increasing function of the scores gives the same answer.
    """
    scores = np.asarray(scores, dtype=float)
    if len(scores) < 2 or scores.shape[1] < 2:
        return np.zeros(len(scores), bool)
    return _two(scores, level) if len(scores) == 2 else _friedman(scores, level)


def _two(scores: np.ndarray, level: float) -> np.ndarray:
    ranks = scipy.stats.rankdata(scores).reshape(scores.shape)
    difference = ranks[0] - ranks[1]
    if not difference.any():
        return np.zeros(2, bool)
    worse = int(difference.sum() < 0)
    test: Any = scipy.stats.wilcoxon(
        difference, alternative="less" if worse else "greater", zero_method="zsplit", method="exact"
    )
    return np.arange(2) == (worse if test.pvalue < level else -1)


def _friedman(scores: np.ndarray, level: float) -> np.ndarray:
    k, n = scores.shape
    ranks = scipy.stats.rankdata(scores, axis=0)
    sums = ranks.sum(axis=1)
    spread = float((ranks**2).sum()) - n * k * (k + 1) ** 2 / 4
    if spread <= 0:
        return np.zeros(k, bool)  # nothing but ties
    statistic = (k - 1) * float(((sums - n * (k + 1) / 2) ** 2).sum()) / spread
    if scipy.stats.chi2.sf(statistic, k - 1) >= level:
        return np.zeros(k, bool)
    left = max(1 - statistic / (n * (k - 1)), 0.0)  # 0 when all seeds agree
    error = np.sqrt(2 * n * left * spread / ((n - 1) * (k - 1)))
    return sums - sums.min() > scipy.stats.t.ppf(1 - level / 2, (n - 1) * (k - 1)) * error
