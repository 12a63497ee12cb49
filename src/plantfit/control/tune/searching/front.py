"""Controllers none of which is better in every figure: a front of two or three, by one search for each of its
points."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from plantfit.control.tune.searching.parts import Searches
from plantfit.control.tune.searching.search import Goal, Search
from plantfit.errors import SpecError

EDGE = 0.02  # the least share of a figure, so that an end of the front is no point that is bad in all others
MOST_FIGURES = 3


@dataclass(frozen=True, eq=False)
class Front:
    """`points` (k, d) of the cube, the first figure growing, and their `figures` (k, m) over all plants, counted in
    `sizes` (those of SIMC on the best fit)."""

    names: tuple[str, ...]
    points: np.ndarray
    figures: np.ndarray


def check_front(names: tuple[str, ...], points: int) -> None:
    """Raises SpecError for a front that cannot be drawn."""
    if len(set(names)) != len(names) or not 2 <= len(names) <= MOST_FIGURES:
        raise SpecError(
            "A front has two or three different figures, not "
            f"{', '.join(names) or 'none'}; write for example iae,input_noise."
        )
    if not 3 <= points <= 100:
        raise SpecError(f"A front of {points} points cannot be searched; give 3 to 100.")


def directions(figures: int, count: int) -> np.ndarray:
    """Shares (k, figures) that add up to 1, about `count` of them: evenly along a line for two, on a triangle for
    three."""
    parts = count - 1
    if figures > 2:
        parts = next(p for p in range(1, count + 1) if (p + 1) * (p + 2) // 2 >= count)
    rows = [v for v in product(range(parts + 1), repeat=figures) if sum(v) == parts]
    shares = np.maximum(np.array(rows, dtype=float) / parts, EDGE)
    return shares / np.sum(shares, axis=1, keepdims=True)


def front_of(
    search: Search, names: tuple[str, ...], begin: np.ndarray, count: int, budget: int, seed: int, searches: Searches
) -> Front:  # fmt: skip
    """The front of these figures over the plants of a search, from the points `begin` (k, d) of the cube on.

    First each figure alone, which gives the ideal and how far the others go; between them every direction minimises its
    worst figure, begun at all points found so far (augmented weighted Chebyshev: R. Steuer, E. Choo, Math. Programming
    26 (1983) 326).
    """
    search = replace(search, weights=dict.fromkeys(names, 1.0 / len(names)))
    m = len(names)
    known = np.atleast_2d(begin)
    seen = search.figures(known)
    ones = np.ones(m)
    for i in range(m):
        alone = Goal(np.zeros(m), ones, np.where(np.arange(m) == i, 1.0, EDGE))
        z = search.nearest(
            alone, known[np.argsort(seen[:, i])[:3]], budget, seed + i, searches.next(f"front, least {names[i]}")
        )
        known = np.r_[known, z[None]]
        seen = np.r_[seen, search.figures(z[None])]
    between = directions(m, count)
    for k, shares in enumerate(between):
        ideal, spread = _frame(seen)
        goal = Goal(ideal, spread, 1.0 / shares / np.sum(1.0 / shares))
        worst = np.max((seen - ideal) / spread * goal.shares, axis=1)
        tell = searches.next(f"front, point {k + 1} of {len(between)}")
        z = search.nearest(goal, known[np.argsort(worst)[:3]], budget, seed + m + k, tell)
        known = np.r_[known, z[None]]
        seen = np.r_[seen, search.figures(z[None])]
    spread = _frame(seen)[1]
    kept = undominated(seen)
    kept = kept[np.lexsort(seen[kept].T[::-1])]
    apart = [kept[0]]
    for k in kept[1:]:  # points that nothing tells apart are one
        if np.max(np.abs(seen[k] - seen[apart[-1]]) / spread) > 1e-3:
            apart.append(k)
    return Front(names, known[apart], seen[apart])


def _frame(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The best of each figure (m,) so far, and how far it goes on the front so far."""
    kept = seen[undominated(seen)]
    ideal = np.min(kept, axis=0)
    return ideal, np.maximum(np.max(kept, axis=0) - ideal, 1e-3 * np.maximum(np.abs(ideal), 1e-12))


def undominated(figures: np.ndarray) -> np.ndarray:
    """The rows (k,) of figures (n, m) to which no other is at least as good in all and better in one."""
    f = np.asarray(figures)
    no_worse = np.all(f[:, None] <= f[None], axis=-1)
    better = np.any(f[:, None] < f[None], axis=-1)
    return np.flatnonzero(~np.any(no_worse & better, axis=0))
