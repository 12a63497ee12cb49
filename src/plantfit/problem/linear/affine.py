"""Which coordinates of a problem enter its residuals linearly: those that variable projection solves for.

Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, take this separation as given; here it is read from the
equations.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate import points
from plantfit.problem.evaluate.box_shares import BoxShares
from plantfit.problem.linear.degree import Degree
from plantfit.problem.linear.record_degrees import residual_degree

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem

# of coordinates with the same products: up to so many the largest set without a product is found, beyond it a large one
MOST_CLASSES = 18
POINTS, TRIES = 2, 8  # at which the guard compares derivatives
ALIKE = 1e-6  # relative difference of derivatives that are the same but for rounding


def affine_coordinates(problem: "Problem") -> tuple[int, ...]:
    """Places of coordinates in which every residual is affine jointly, in their physical values, given the other
    coordinates.

    As many as possible, and of equally many those declared first. Found from the equations, which proves it for all
    values, then compared with derivatives at a few points of the cube; a coordinate that does not agree there is left
    out (a custom derivative may contradict its function). Kept for all variants of the problem.
    """
    return problem.once("affine", lambda: _guarded(problem, affine_by_structure(problem)))


def affine_by_structure(problem: "Problem") -> tuple[int, ...]:
    """The same from the equations alone."""
    space, degree = problem.space, residual_degree(problem)
    local = space.of_one_recording().coordinates
    place = {(c.parameter, c.index): i for i, c in enumerate(local)}
    number = [place[c.parameter, c.index] for c in space.coordinates]
    # bends are linear in cube coordinates, which those searched by decades are not
    excluded = [i for i, c in enumerate(local) if c.log and space.parameters[c.parameter].smooth is not None]
    linear = degree.seen & ~degree.more & ~sum(1 << i for i in excluded)
    chosen = _without_products(
        degree, [i for i in range(len(local)) if linear >> i & 1], np.bincount(number, minlength=len(local))
    )
    assert degree.allows(sum(1 << i for i in chosen))
    return tuple(i for i, n in enumerate(number) if n in chosen)


def _without_products(degree: Degree, candidates: list[int], weight: Sequence[int] | np.ndarray) -> set[int]:
    """Candidates of the largest total weight of which no two are multiplied."""
    classes: dict[tuple[int, ...], list[int]] = {}
    products = sorted(degree.products)
    for i in candidates:  # those that meet the same factors are taken together
        side = tuple((a >> i & 1) - (b >> i & 1) for a, b in products)
        classes.setdefault(side, []).append(i)
    groups, free = [], set(classes.pop((0,) * len(products), []))
    for side, members in classes.items():
        groups.append((np.array(side), members, sum(int(weight[i]) for i in members)))
    apart = [{j for j, (b, _, _) in enumerate(groups) if np.any(a * b < 0)} for a, _, _ in groups]
    kept = _heaviest(apart, [w for _, _, w in groups])
    return free.union(*(groups[k][1] for k in kept))


def _heaviest(apart: list[set[int]], weight: list[int]) -> list[int]:
    """The heaviest set of nodes of a graph without an edge; of equally heavy ones that with the first nodes."""
    if len(apart) > MOST_CLASSES:
        kept: list[int] = []
        for i in sorted(range(len(apart)), key=lambda i: (sum(weight[j] for j in apart[i]) - weight[i], i)):
            if not apart[i] & set(kept):
                kept.append(i)
        return kept
    best: tuple[int, list[int]] = 0, []

    def extend(i: int, kept: list[int], total: int) -> None:
        nonlocal best
        if total + sum(weight[i:]) <= best[0]:
            return
        if i == len(apart):
            best = total, kept
            return
        if not apart[i] & set(kept):
            extend(i + 1, [*kept, i], total + weight[i])
        extend(i + 1, kept, total)

    extend(0, [], 0)
    return best[1]


# -- the guard ------------------------------------------------------------------------------------------


def _guarded(problem: "Problem", found: tuple[int, ...]) -> tuple[int, ...]:
    """Those whose derivatives do not change when all found are moved."""
    if not found:
        return ()
    places, rng, checked = np.array(found), np.random.default_rng(0), 0
    right = np.ones(len(found), dtype=bool)
    for _ in range(TRIES):
        z = rng.uniform(0.1, 0.9, problem.space.dimension)
        other = z.copy()
        other[places] = rng.uniform(0.1, 0.9, len(found))
        agree = _agree(problem, places, z, other)
        if agree is not None:
            right, checked = right & agree, checked + 1
        if checked == POINTS:
            break
    return tuple(int(i) for i in places[right])


def _blocks(problem: "Problem", z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """As `Problem.blocks`, by the program that the search of a small problem compiles anyway."""
    if points.shared(problem):
        return [(*points.residuals_and_jacobian(problem, z), np.arange(problem.space.dimension))]
    return problem.blocks(z)


def _agree(problem: "Problem", places: np.ndarray, z: np.ndarray, other: np.ndarray) -> np.ndarray | None:
    """For every coordinate whether residuals are linear between two points; None where they cannot be simulated."""
    shares = BoxShares.of(problem.space, places)
    move = shares.of_cube(other[places]) - shares.of_cube(z[places])
    right, total, size = np.ones(len(places), dtype=bool), 0.0, 0.0
    first, second = (_blocks(problem, p) for p in (z, other))
    for (r, j, own), (s, k, _) in zip(first, second, strict=True):
        inside = np.isin(places, own)
        columns = np.searchsorted(own, places[inside])
        before = j[:, columns] / shares.slope(z[places])[inside]
        after = k[:, columns] / shares.slope(other[places])[inside]
        if not all(np.all(np.isfinite(a)) for a in (r, s, before, after)):
            return None
        largest = np.maximum(np.abs(before), np.abs(after)).max(axis=0, initial=0.0)
        right[inside] &= np.abs(before - after).max(axis=0, initial=0.0) <= ALIKE * largest
        moved = before * move[inside]
        total = max(total, float(np.abs(s - r - moved.sum(axis=1)).max(initial=0.0)))
        size = max(size, float(np.abs(r).max(initial=0.0)), float(np.abs(moved).max(initial=0.0)))
    return right & (total <= ALIKE * size)
