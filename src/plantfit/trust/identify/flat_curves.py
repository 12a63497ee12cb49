"""Curves in the space of the parameters along which nothing that is measured changes."""

from dataclasses import dataclass
from itertools import combinations as choices
from itertools import islice

import numpy as np

from plantfit.errors import ModelError
from plantfit.trust.identify.combinations import RANK, Combinations
from plantfit.trust.verdict.words import number, some

SUBSETS = 20_000  # of parameters that are tried at most
STEPS = 400  # along a curve to either side at most
STEP = 0.01  # of the box


@dataclass(frozen=True)
class FlatCurve:
    """Points (n, d) from one bound to the other through the answer, at place `at`; `arc` (n,) is the way from it in
    widths of the box.

    `moving` are the parameters that change, `deviation` the largest relative change of a determined combination along
    the curve.
    """

    names: tuple[str, ...]
    moving: tuple[str, ...]
    points: np.ndarray
    arc: np.ndarray
    at: int
    deviation: float

    @property
    def sentence(self) -> str:
        first, last = (
            ", ".join(f"{n} = {number(p[self.names.index(n)])}" for n in self.moving)
            for p in (self.points[0], self.points[-1])
        )
        verb = "can move alone" if len(self.moving) == 1 else "can move together"
        kept = f"what is determined changes by less than {max(self.deviation, 1e-15):.0e} of its size"
        return f"{some(self.moving, most=8)} {verb} unseen, from {first} to {last}: {kept}."


def flat_curves(found: Combinations, point: np.ndarray) -> tuple[FlatCurve, ...]:
    """One exact curve through `point` (d,) for each flat direction there, each moving as few parameters as can be.

    The tangent is integrated by Heun's rule and every step is brought back onto the determined combinations by Newton's
    method, as far as the box reaches. Raises ModelError for a point outside the box.
    """
    point, width = np.asarray(point, dtype=float), found.upper - found.lower
    slack = 1e-9 * width
    outside = np.flatnonzero((point < found.lower - slack) | (point > found.upper + slack))
    if len(outside):
        i = outside[0]
        raise ModelError(
            f"{found.names[i]} = {point[i]:g} lies outside its bounds "
            f"[{found.lower[i]:g}, {found.upper[i]:g}]; give a point inside."
        )
    return tuple(_curve(found, point, moving) for moving in smallest_sets(found, point))


def smallest_sets(found: Combinations, point: np.ndarray) -> list[np.ndarray]:
    """Sets of parameters, by number, of which each can move only as a whole: one for each flat direction, the
    smallest first."""
    jacobian = _scaled(found, point)
    d = len(found.names)
    sets: list[np.ndarray] = []
    directions = np.zeros((0, d))
    wanted = d - _rank(jacobian)
    subsets = (np.array(s) for size in range(1, found.rank + 2) for s in choices(range(d), size))
    for subset in islice(subsets, SUBSETS):
        if len(sets) == wanted:
            break
        tangent = _tangent(jacobian, subset)
        if tangent is not None and _rank(np.vstack([directions, tangent])) > len(directions):
            sets.append(subset)
            directions = np.vstack([directions, tangent])
    return sets


def _scaled(found: Combinations, point: np.ndarray) -> np.ndarray:
    """The Jacobian by the unit box, its rows of length 1."""
    rows = found.jacobian(point) * (found.upper - found.lower)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)


def _rank(matrix: np.ndarray) -> int:
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(singular > 100.0 * RANK * max(singular[0], 1e-300))) if matrix.size else 0


def _tangent(jacobian: np.ndarray, subset: np.ndarray) -> np.ndarray | None:
    """The direction (d,) in which exactly the parameters `subset` move and no row changes; None where there is none
    or more than one."""
    columns = jacobian[:, subset]
    if _rank(columns) != len(subset) - 1:
        return None
    null = np.linalg.svd(columns)[2][-1]
    if np.min(np.abs(null)) < 1e-7:
        return None  # a smaller set moves
    tangent = np.zeros(jacobian.shape[1])
    tangent[subset] = null
    return tangent


def _curve(found: Combinations, point: np.ndarray, subset: np.ndarray) -> FlatCurve:
    target = found.function(point)
    forward, backward = (_walk(found, point, subset, target, sign) for sign in (1.0, -1.0))
    points = np.vstack([backward[::-1], point[None], forward])
    away = np.linalg.norm(np.diff(points, axis=0) / (found.upper - found.lower), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(away)])
    size = np.maximum(np.abs(target), 1e-300)
    deviation = max(float(np.max(np.abs(found.function(p) - target) / size)) for p in points)
    return FlatCurve(
        found.names, tuple(found.names[i] for i in subset), points, arc - arc[len(backward)], len(backward), deviation
    )


def _walk(found: Combinations, point: np.ndarray, subset: np.ndarray, target: np.ndarray, sign: float) -> np.ndarray:
    """Points (n, d) from `point` (left out) to where a bound is met."""
    low, width = found.lower, found.upper - found.lower
    points: list[np.ndarray] = []
    u, step = (point - low) / width, STEP
    tangent = _tangent(_scaled(found, point), subset)
    heading = None if tangent is None else sign * tangent
    while heading is not None and len(points) < STEPS and step > 1e-6 * STEP:
        middle = _along(found, u + 0.5 * step * heading, subset, heading)
        there = None if middle is None else _back(found, u + step * middle, subset, target)
        if there is None or np.any(there < 0.0) or np.any(there > 1.0):
            step /= 2.0
            continue
        u = there
        points.append(low + width * u)
        heading = _along(found, u, subset, heading)
    return np.array(points).reshape(-1, len(point))


def _along(found: Combinations, u: np.ndarray, subset: np.ndarray, heading: np.ndarray) -> np.ndarray | None:
    """The tangent at the cube point u that goes on in the direction of `heading`."""
    tangent = _tangent(_scaled(found, found.lower + (found.upper - found.lower) * u), subset)
    return None if tangent is None else np.copysign(1.0, tangent @ heading) * tangent


def _back(found: Combinations, u: np.ndarray, subset: np.ndarray, target: np.ndarray) -> np.ndarray | None:
    """The nearest cube point at which the combinations have their values again; None where Newton's method fails."""
    width, size = found.upper - found.lower, np.maximum(np.abs(target), 1e-300)
    for _ in range(20):
        p = found.lower + width * u
        miss = (found.function(p) - target) / size
        if not np.all(np.isfinite(miss)):
            return None
        if np.max(np.abs(miss)) < 1e-14:
            return u
        slope = (found.jacobian(p) * width / size[:, None])[:, subset]
        change = np.linalg.lstsq(slope, -miss)[0]
        u = u.copy()
        u[subset] += change
        if np.max(np.abs(change)) < 1e-15:
            break
    return u if np.max(np.abs(miss)) < 1e-12 else None
