"""What a coordinate costs where it is held: all others fitted anew, and whether the data stop it there or the room."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

import plantfit.runtime  # noqa: F401
from plantfit.optimize.local.separable import Block, usable
from plantfit.problem.evaluate import points
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.follow.room import Room
from plantfit.trust.intervals.ranges import EDGE, Linear

STEPS = 8  # of one refit that falls slowly
SMALL = 1e-5  # damping of the others, relative to the largest derivative
# A step that takes off less than `FELL` of the growth ends a refit after `STEPS`, and after `SOME` if the growth is
# still above `HOPELESS` times the threshold. A refit that falls faster may take `MOST` steps.
FELL, SOME, HOPELESS, MOST = 0.3, 3, 100.0, 24
INSIDE = 1.3  # times the distance of a bound from the limit, where the effect of a coordinate is compared
FADES = 0.3  # power of that distance, above which an effect is taken to fade towards the limit
WIDER, LEVELS = 4, 3  # tries of wider rooms for one end, and how many rooms one try goes through
FALLS = 0.5  # of a growth over the threshold: one that keeps more in a wider room does not come down to it
ENOUGH = 0.5  # of the threshold: a refit that has come so far is inside


@dataclass(frozen=True)
class Place:
    """One coordinate held `at` a place of its edge of the cube, the others fitted anew.

    `share`: growth of the sum of squares over the threshold; `point` (d,), `residuals` (k,), `jacobian` (k, d) there.
    `settled`: the refit cannot fall noticeably further; `leans`: on a bound that is no physical limit, and could fall
    to the threshold beyond it; `limited`: where it leans, physics sets a limit somewhere beyond. `stopped`: it costs
    more than the threshold wherever the coordinates on bounds may go, and `held`: that was tried in wider rooms.
    """

    at: float
    share: float
    point: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    settled: bool = True
    leans: bool = False
    limited: bool = True
    stopped: bool = False
    held: bool = False


class Refits:
    """Refits of `problem` around the cube point z (d,), with at most so many Jacobians.

    Points are those of a cube of its own, `room`, which reaches some way beyond the bounds of the search.
    """

    def __init__(self, problem: Problem, z: np.ndarray, linear: Linear, allowed: int):
        self.problem, self.room, self.linear, self.left = problem, Room.of(problem), linear, allowed
        self.z = self.room.inner(z)
        self.count = sum(problem.parts.counts.values())
        self.first = self.rows(self.z)
        self.least = float(self.first[0] @ self.first[0])
        space = problem.space
        self.limits = np.array([c.limits for c in space.coordinates]).reshape(-1, 2)
        self.lower, self.upper = self.room.lower, self.room.upper
        self.times = 1.0  # the threshold, how much an answer may cost
        # wider rooms that may be tried for a coordinate and side; none in such a room
        self.tries: dict[tuple[int, bool], int] | None = {}
        # of the sum of squares over the variance, at every point that a refit ended at
        self.growths = {self.z.tobytes(): 0.0}

    def rows(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and derivatives in few rows whose squares sum to those of all samples."""
        r, j = points.compressed(self.problem, self.room.outer(z))
        scale = np.sqrt(self.count / len(r))
        return r * scale, j * self.room.width * scale

    def value(self, i: int, at: float) -> float:
        whole = self.z.copy()
        whole[i] = at
        return float(self.room.physical(whole)[i])

    def cube(self, i: int, value: float, edge: float) -> float:
        """The place of a value on the edge i of the cube, inside the box."""
        if not self.lower[i] < value < self.upper[i]:
            return edge
        whole = self.linear.values.copy()
        whole[i] = value
        return float(self.room.cube(whole)[i])

    def within(self, x: np.ndarray) -> np.ndarray:
        """The cube point of the linear problem's x (d,), inside the box; the answer where that is far."""
        if not np.all(np.isfinite(x)) or np.max(np.abs(x), initial=0.0) > 1.0:
            return self.z
        return np.clip(
            self.room.cube(np.clip(self.linear.values + x * self.linear.size, self.lower, self.upper)), 0.0, 1.0
        )

    def predicted(self, i: int, inside: Place, at: float) -> np.ndarray:
        """Where the others go when coordinate i moves to `at`, by the derivatives at the nearest place inside the
        range."""
        others = np.arange(len(self.z)) != i
        columns = inside.jacobian[:, others]
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        moved = inside.residuals + (at - inside.at) * inside.jacobian[:, i]
        rows = np.vstack([columns, SMALL * np.max(scale, initial=0.0) * np.eye(int(others.sum()))])
        right = np.r_[-moved, np.zeros(int(others.sum()))]
        point = inside.point.copy()
        low, high = -point[others] - 1e-15, 1.0 - point[others] + 1e-15
        change = np.linalg.lstsq(rows, right)[0]
        if np.any((change < low) | (change > high)):
            change = lsq_linear(rows, right, (low, high), method="bvls").x
        point[others] = np.clip(point[others] + change, 0.0, 1.0)
        return point

    def straight(self, i: int, inside: Place, at: float) -> np.ndarray:
        """Where the others go by the same derivatives in their own units, in which a value near zero on a logarithmic
        scale may grow by decades: by its logarithm it seems to do nothing."""
        others = np.arange(len(self.z)) != i
        slopes, values = self.room.slopes(inside.point), self.room.physical(inside.point)
        columns = inside.jacobian / slopes
        sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)[others]
        moved = inside.residuals + (self.value(i, at) - values[i]) * columns[:, i]
        rows = np.vstack([columns[:, others] / sizes, SMALL * np.eye(int(others.sum()))])
        low, high = ((end - values)[others] * sizes - sign * 1e-15 for end, sign in ((self.lower, 1), (self.upper, -1)))
        change = lsq_linear(rows, np.r_[-moved, np.zeros(int(others.sum()))], (low, high), method="bvls").x
        whole = values.copy()
        whole[others] = np.clip(values[others] + change / sizes, self.lower[others], self.upper[others])
        point = np.clip(self.room.cube(whole), 0.0, 1.0)
        point[i] = at
        return point

    def searched(self, point: np.ndarray, steps: int) -> Block:
        """A search of all coordinates from a point (d,), of so many steps at most."""
        self.left = max(self.left, 2 * STEPS)
        block = Block(np.arange(len(point)), point, *self.rows(point), tolerance=1e-9, damping=SMALL**2)
        for _ in range(steps if usable(block.residuals, block.jacobian) else 0):
            step, promised = block.step()
            if block.done or promised <= 1e-3 * self.linear.variance:
                break
            self.left -= 1
            block.update(step, promised, *self.rows(np.clip(block.x + step, 0.0, 1.0)))
        return block

    def place(self, i: int, point: np.ndarray) -> Place:
        """A point (d,) that was met, with what is known there."""
        self.left -= 1
        return Place(
            float(point[i]),
            self.growths[point.tobytes()] / (self.times * self.linear.threshold[i]),
            point,
            *self.rows(point),
        )

    def grown(
        self,
        i: int,
        at: float,
        start: np.ndarray,
        enough: float = ENOUGH,
        otherwise: Callable[[], np.ndarray] | None = None,
    ) -> Place | None:
        """The others fitted anew with coordinate i held, from `start` (d,), until the growth is `enough` of the
        threshold; None where it cannot be simulated.

        Where `start` costs far more than the threshold, or cannot be simulated, it begins at `otherwise()` if that
        costs less.
        """
        point, places = np.clip(start, 0.0, 1.0), np.array([k for k in range(len(self.z)) if k != i], dtype=int)
        point[i] = at
        top = self.times * self.linear.threshold[i] * self.linear.variance
        whole: dict[str, np.ndarray] = {}

        def evaluated(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            trial = point.copy()
            trial[places] = x
            self.left -= 1
            r, j = self.rows(trial)
            whole["tried"] = j
            return r, j[:, places]

        def begun() -> Block:
            x = point[places].copy()
            return Block(places, x, *evaluated(x), tolerance=1e-9, damping=SMALL**2)

        block = begun()
        whole["kept"] = whole["tried"]
        if otherwise is not None and not block.cost - self.least <= HOPELESS * top:
            point = otherwise()
            second = begun()
            if usable(second.residuals, second.jacobian) and not block.cost <= second.cost:
                block, whole["kept"] = second, whole["tried"]
        if not usable(block.residuals, block.jacobian):
            return None
        settled, fell = not len(places), 1.0
        for taken in range(MOST if len(places) else 0):
            growth = block.cost - self.least
            if fell < FELL and (taken >= STEPS or (taken >= SOME and growth > HOPELESS * top)):
                break
            if growth <= enough * top:
                break  # inside, which is what was asked
            step, promised = block.step()
            settled = bool(block.damping <= 1e-3 and promised <= max(0.02 * top, 0.05 * growth))
            if settled:
                break
            before = block.cost
            block.update(step, promised, *evaluated(np.clip(block.x + step, 0.0, 1.0)))
            fell = (before - block.cost) / growth
            if block.cost < before:
                whole["kept"] = whole["tried"]
            if block.done or self.left <= 0:
                settled = block.done
                break
        point[places] = block.x
        share = (block.cost - self.least) / top
        self.growths[point.tobytes()] = float(share) * top / self.linear.variance
        place = Place(
            at, float(share), point, block.residuals, whole["kept"], settled, *self._leans(point, places, block, top)
        )
        return (
            replace(place, leans=False, limited=True, stopped=True, held=True) if self._held_anyway(i, place) else place
        )

    def _held_anyway(self, i: int, place: Place) -> bool:
        """Whether a place that leans stays above the threshold where coordinates may go `FACTOR` times as near to their
        limits, so that the data hold it and not the room.

        Two that leave the room together, as a gain and the resistance that divides it, may pull without end there and
        change nothing.
        """
        side = i, bool(place.at > self.z[i])
        if self.tries is None or not place.leans or not place.settled or place.share <= 1.0:
            return False
        if self.tries.setdefault(side, WIDER) == 0:
            return False
        walk: Refits = self
        held, before = False, place
        for _ in range(LEVELS):
            start = walk.room.outer(before.point)
            walk = walk._wider(i)
            found = walk.grown(i, float(walk.room.inner(start)[i]), walk.room.inner(start), 0.0)
            if found is None or not found.settled or found.share <= 1.0:
                break
            held = not found.leans or found.share >= 1.0 + FALLS * (before.share - 1.0)
            if held:
                break
            before = found
        self.tries[side] -= not held
        return held

    def beyond_room(self, i: int, outside: Place) -> float:
        """The growth over the threshold to which a place outside of a range, with others on edges of the room, comes
        down in wider rooms.

        Where it comes down into the range, the room has set this end, and not the data.
        """
        walk: Refits = self
        for _ in range(LEVELS if self.tries is not None else 0):
            if outside.share <= 1.0 or not walk._on_edges(i, outside):
                break
            start = walk.room.outer(outside.point)
            walk = walk._wider(i)
            found = walk.grown(i, float(walk.room.inner(start)[i]), walk.room.inner(start))
            if found is None:
                break
            outside = found
        return outside.share

    def _on_edges(self, i: int, place: Place) -> bool:
        """Whether others than coordinate i are on edges of the room that lie beyond the bounds of the search."""
        space, on = self.problem.space, np.abs(place.point - 0.5) >= 0.5 - EDGE
        beyond = np.where(place.point < 0.5, self.lower < space.lower, self.upper > space.upper)
        return bool(np.any(on & beyond & (np.arange(len(on)) != i)))

    def _wider(self, i: int) -> "Refits":
        """The same in a room that is wider for all coordinates but i."""
        wide = copy(self)
        wide.room = self.room.wider(i)
        wide.z, wide.tries, wide.growths = wide.room.inner(self.room.outer(self.z)), None, {}
        wide.lower, wide.upper, wide.left = wide.room.lower, wide.room.upper, 2 * STEPS
        return wide

    def _leans(self, point: np.ndarray, places: np.ndarray, block: Block, top: float) -> tuple[bool, bool, bool]:
        """Whether coordinates on bounds that are no physical limits could lower the sum noticeably beyond these, and to
        the threshold, whether physics limits all of them, and whether the sum stays above the threshold wherever they
        go, as far as the derivatives tell.

        By the gradient, which a convex sum never falls faster than, and by what is left of it where the coordinates off
        their bounds have moved to their best: a refit may end a little before, and they go along with those on bounds.
        A coordinate whose effect does not fade towards its physical limit, as that of a divisor, may lower the sum to
        anything.
        """
        inner = block.jacobian[:, (block.x > EDGE) & (block.x < 1.0 - EDGE)]
        left = (
            block.residuals - inner @ np.linalg.lstsq(inner, block.residuals)[0] if inner.shape[1] else block.residuals
        )
        gradient, most, noticed = 2.0 * block.jacobian.T @ left, 0.0, []
        moving = (block.x > EDGE) & (block.x < 1.0 - EDGE)
        for k, x, g in zip(places, block.x, gradient, strict=True):
            side = 0 if x <= EDGE and g > 0 else 1 if x >= 1.0 - EDGE and g < 0 else None
            if side is None:
                continue
            bound = self.lower[k] if side == 0 else self.upper[k]
            room = abs(self.limits[k][side] - bound)
            slope = (
                bound * np.log(self.upper[k] / self.lower[k])
                if self.problem.space.log[k]
                else self.upper[k] - self.lower[k]
            )
            if abs(g) / slope * min(room, max(abs(bound), self.linear.size[k])) > 0.1 * top:
                noticed.append((int(k), side))
            most += abs(g) / slope * room
            moving |= places == k
        above = block.cost - self.least - top
        columns = block.jacobian[:, moving]
        lowest = block.residuals - columns @ np.linalg.lstsq(columns, block.residuals)[0]
        falls = min(most, block.cost - float(lowest @ lowest))
        steep = bool(noticed) and above > falls and any(self._steep(point, *c) for c in noticed)
        leans = bool(noticed) and (above <= most or steep)
        return leans, bool(not leans or np.isfinite(most)), bool(above > falls and not steep)

    def _steep(self, point: np.ndarray, k: int, side: int) -> bool:
        """Whether what coordinate k does on its bound does not fade towards its physical limit: by its derivatives
        with respect to the logarithm of the distance from there, on the bound and a little inside."""
        bound, limit = (self.lower[k], self.limits[k][0]) if side == 0 else (self.upper[k], self.limits[k][1])
        if not np.isfinite(limit) or bound == limit:
            return False
        inside = point.copy()
        inside[k] = self.cube(k, limit + INSIDE * (bound - limit), float(1 - side))
        self.left -= 2
        effects = [
            abs(self.value(k, z[k]) - limit) / self.room.slopes(z)[k] * self.rows(z)[1][:, k] for z in (point, inside)
        ]
        at, beside = (float(np.linalg.norm(e)) for e in effects)
        return bool(np.isfinite(at + beside) and np.log(max(beside, 1e-300) / max(at, 1e-300)) < FADES * np.log(INSIDE))
