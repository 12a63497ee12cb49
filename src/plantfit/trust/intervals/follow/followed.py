"""One end of a range followed on the problem: a parameter is moved, all others are fitted anew, and the cost is
compared."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.follow.refits import ENOUGH, STEPS, Place, Refits
from plantfit.trust.intervals.ranges import EDGE, Linear, Range, linear_end

SHORT = 0.02  # of the way so far, or of the cube: steps below are not tried
PROBES = 18  # refits for one end
# of an end's distance, and times its distance from a physical limit: how near it has to be found by wider rooms
CLOSE, NEARER = 0.3, 2.0
NEAR = 0.15  # of an end's distance: how near it is found where the linear problem was wrong
ALIKE = (0.6, 1.6)  # growth at a linear end over the threshold, between which it is taken as found
OUTSIDE = 10.0  # sizes of a value that the linear problem is believed outside of the box
WIDE = 0.5  # sizes of a value up to which a linear end is believed untried
CLIFF = 10.0  # times the growth at the last place inside: near to it a parabola has much less
NARROWED = 4  # halvings between places that have a cliff between them
BETWEEN = 6  # places between the ends of a wide range that are looked at
FURTHER = 1.3  # times the distance of an end at which it is tried from elsewhere whether the range goes on
# times the standard errors of a range (three in all) up to which it is looked for a valley that opens just beyond
BEYOND = 1.5
OPENS = 2.5  # times as far a range may reach there before it is taken to open
AROUND = 4  # refits to each side of another answer
LOST = 300.0  # times the threshold: a refit that ends above it is taken for one that found no way
HELD, AGREED = 1e5, 1e3  # that, where wider rooms hold it too, or where two refits at one place found the same
EACH = 8  # times the Jacobians of a refit: those that each end may take without success, whatever others took
SAME = 0.01  # of a growth: two refits at one place that differ by less have found the same
GROWS = 2.0  # steps after one that succeeded, beside the longest one so far
SLIGHT = 0.05  # of the threshold: a growth below says nothing about where an end lies
FARTHER = 10.0  # times the way so far at which it is tried whether the data stop a range that leans on a bound


class Followed(Refits):
    """Ranges of the coordinates of `problem` around the cube point z (d,), with at most so many Jacobians.

    Where a range reaches its end, or a refit leans on a bound of the room that is no physical limit, the linear problem
    says how it goes on.
    """

    def __init__(self, problem: Problem, z: np.ndarray, linear: Linear, allowed: int):
        super().__init__(problem, z, linear, allowed)
        self.met: list[np.ndarray] = []

    def range(self, i: int) -> Range:
        """The range of coordinate i."""
        self.met = []
        ends = [self._end(i, sign) for sign in (-1.0, 1.0)]
        found = Range(min(ends[0], self.linear.values[i]), max(ends[1], self.linear.values[i]), list(self.met))
        self.open_at_edges(i, found)
        return found

    def open_at_edges(self, i: int, found: Range) -> None:
        """Open the other end of a range that has one open end, where it lies at the edge of the room, or near it and
        beyond the bounds of the search: a refit there that did not come down is rather one that was lost."""
        ends = found.low, found.high
        if ends[1] == self.limits[i][1] and self._at_the_edge(i, ends[0], 0.0, bool(np.isinf(ends[1]))):
            found.low = float(self.limits[i][0])
        if ends[0] == self.limits[i][0] and self._at_the_edge(i, ends[1], 1.0, bool(np.isinf(ends[0]))):
            found.high = float(self.limits[i][1])

    def _at_the_edge(self, i: int, end: float, edge: float, near: bool) -> bool:
        if not near or not self.lower[i] < end < self.upper[i]:
            return end == self.value(i, edge)
        at = self.cube(i, end, edge)
        outer = float(self.room.outer(np.where(np.arange(len(self.z)) == i, at, self.z))[i])
        return abs(at - edge) <= NEAR and not 0.0 <= outer <= 1.0

    def narrow(self, i: int, found: Range) -> bool:
        """Whether a range is short beside the value."""
        return self._reach(i, found) <= WIDE * float(self.linear.size[i])

    def _reach(self, i: int, found: Range) -> float:
        """How far a range goes from the value at most."""
        value = float(self.linear.values[i])
        return max(found.high - value, value - found.low)

    def look_between(self, i: int, found: Range) -> None:
        """Refits at places between the ends of a wide range of coordinate i, and what they met.

        A parameter that means nothing at the answer may mean much in the middle of its range, where others then have
        other values.
        """
        first, last = self.cube(i, found.low, 0.0), self.cube(i, found.high, 1.0)
        known = [self.z, *found.points]
        self.left = max(self.left, BETWEEN * STEPS)
        for at in np.linspace(first, last, BETWEEN + 2)[1:-1]:
            nearest = min(known, key=lambda z: abs(float(z[i]) - float(at)))
            place = self.grown(i, float(at), nearest)
            if place is not None and place.share <= 1.0:
                known.append(place.point)
                found.points.append(place.point)

    def go_on(self, i: int, found: Range, starts: Sequence[np.ndarray]) -> None:
        """Follow coordinate i beyond its range from points `starts` (d,) that cost as little as the answer, and keep
        what is met."""
        self.met, self.left = [], max(self.left, 8 * STEPS)
        for sign, edge in ((-1.0, 0.0), (1.0, 1.0)):
            for start in starts:
                end = found.low if sign < 0 else found.high
                last = self.cube(i, end, edge)
                at = float(np.clip(self.z[i] + FURTHER * (last - self.z[i]), 0.0, 1.0))
                if at == last or not np.isfinite(end) or self.left <= 0:
                    break
                place = self.grown(i, at, self.predicted(i, self.place(i, start), at))
                if place is None or place.share > 1.0:
                    continue
                self.met.append(place.point)
                self.left = max(self.left, 2 * STEPS)
                end = self._march(i, sign, place, self._next(self.z[i], edge, place, None), None, end, on=True)
                found.low, found.high = min(found.low, end), max(found.high, end)
        found.points.extend(self.met)

    def look_beyond(self, i: int, found: Range, starts: Sequence[np.ndarray]) -> None:
        """Widen a narrow range to that of three standard errors where a valley opens just beyond it.

        One answer in twenty has the truth beyond its range. If the range is short only because it ends before the
        valley, these are the answers that would be called determined.
        """
        self.times = BEYOND**2
        beyond = Range(found.low, found.high)
        self.go_on(i, beyond, starts)
        self.times = 1.0
        wide, known = WIDE * float(self.linear.size[i]), self._reach(i, found)
        if self._reach(i, beyond) > max(wide, min(BEYOND * wide, OPENS * known)):
            found.low, found.high = beyond.low, beyond.high

    def around(self, i: int, found: Range, point: np.ndarray) -> None:
        """Widen the range of coordinate i to the ends that it has around another answer `point` (d,).

        The first try to each side is where the linear problem there says that it ends.
        """
        place = self.place(i, point)
        columns = np.delete(place.jacobian, i, axis=1)
        shadow = place.jacobian[:, i] - columns @ np.linalg.lstsq(columns, place.jacobian[:, i])[0]
        top = self.linear.threshold[i] * self.linear.variance
        step = np.sqrt(max(1.0 - place.share, 0.0) * top / max(float(shadow @ shadow), 1e-300))
        for sign in (-1.0, 1.0):
            inside, at = place, float(np.clip(place.at + sign * step, 0.0, 1.0))
            end = place.at
            for _ in range(AROUND):
                if at == inside.at:
                    break
                self.left = max(self.left, 2 * STEPS)
                tried = self.grown(i, at, self.predicted(i, inside, at), 0.0)
                if tried is None:
                    break
                if tried.share > 1.0:
                    end = self._between(inside, tried)
                    break
                inside, end = tried, tried.at
                found.points.append(tried.point)
                if tried.share >= ALIKE[0] or at in (0.0, 1.0):
                    break
                further = (at - place.at) / np.sqrt(max(tried.share, SLIGHT))
                at = float(np.clip(place.at + further, 0.0, 1.0))
            found.low, found.high = min(found.low, self.value(i, end)), max(found.high, self.value(i, end))

    def elsewhere(self, end: np.ndarray, stay: bool = False) -> np.ndarray | None:
        """The point (d,) where a search from another one's `end` (d,) stops, or with `stay` that end itself, if it
        costs little more than the answer; both of `room`."""
        block = self.searched(np.clip(np.asarray(end, dtype=float), 0.0, 1.0), 0 if stay else STEPS)
        top = max(float(np.max(self.linear.threshold)), self.linear.quantile**2) * self.linear.variance
        if not np.isfinite(block.cost) or block.cost - self.least > top:
            return None
        self.growths[block.x.tobytes()] = float(block.cost - self.least) / self.linear.variance
        return block.x

    def within_bounds(self, point: np.ndarray) -> bool:
        """Whether a point (d,) of `room` lies within the bounds of the search."""
        outer = self.room.outer(point)
        return bool(np.all((outer >= -EDGE) & (outer <= 1.0 + EDGE)))

    def _end(self, i: int, sign: float) -> float:
        """Where the range of coordinate i ends to one side, in its unit."""
        step, x = linear_end(self.linear, i, sign)
        end = float(self.linear.values[i] + sign * step * self.linear.size[i])
        if step > OUTSIDE and not self.lower[i] <= end <= self.upper[i]:
            # where nothing can be simulated the linear problem is not followed far
            end = float(self.limits[i][1 if sign > 0 else 0])
        edge = 0.0 if sign < 0 else 1.0
        if abs(edge - float(self.z[i])) <= EDGE or step == 0.0:
            return end
        here = Place(float(self.z[i]), 0.0, self.z, *self.first)
        self.left = max(self.left, EACH * STEPS)
        return self._march(i, sign, here, self.cube(i, end, edge), self.within(x), end)

    def _march(
        self, i: int, sign: float, inside: Place, at: float, start: np.ndarray | None, end: float, on: bool = False
    ) -> float:
        """Where the range ends, from a place `inside` of it: `at` is tried first, from `start` (d,) if given; `end` is
        known so far.

        Steps grow after success and become short after a refit that found no way; those that succeed are not counted.
        `on`: from elsewhere, where `at` is no end of the linear problem.
        """
        here, edge, outside = float(self.z[i]), 0.0 if sign < 0 else 1.0, None
        again, longest = None, np.inf
        if at == inside.at:
            return self._beyond(i, sign, inside.share, end)
        for probe in range(PROBES):
            left = self.left
            # at the edge of the box the growth itself says how the range goes on
            enough = 0.5 * SLIGHT if at == edge else ENOUGH
            first = self.predicted(i, inside, at) if start is None else start
            found = self.grown(i, at, first, enough, partial(self.straight, i, inside, at))
            if found is not None and again is not None and at == again.at and self._agreed(i, inside, found, again):
                outside = again
                break
            ended = found is not None and found.settled and found.limited
            if found is None or (
                found.share > 1.0 and not (ended and (found.share <= LOST or (found.share <= HELD and found.held)))
            ):
                # too far for one refit, or for the box
                if found is not None and found.leans and not (outside is not None and outside.held):
                    outside = None  # what was found further out, from another place, says nothing
                    if self._beyond_bounds(i, inside) and inside.share < 0.5:
                        break  # far enough
                if abs(at - inside.at) < SHORT * max(abs(inside.at - here), SHORT) or self.left <= 0:
                    if found is not None and ended and (found.held or not found.leans):  # else the room may hold it
                        outside = found
                    break
                at, start = inside.at + (0.3 if found is None or found.share > 10.0 else 0.5) * (at - inside.at), None
                longest = abs(at - inside.at)
                continue
            if found.share <= 1.0:
                inside, self.left = found, left
                longest *= GROWS
                self.met.append(found.point)
            elif found.leans:  # a bound may hold what the data do not
                if at == edge:
                    return float(self.limits[i][1 if sign > 0 else 0])
                # a refit further out, from another place, says nothing beyond it
                inside = replace(found, share=1.0)
                outside = outside if outside is not None and outside.held else None
                self.left = max(self.left, STEPS)
            else:
                outside = found
            if probe == 0 and not on and inside.share < 1.0 and ALIKE[0] <= found.share <= ALIKE[1] and at != edge:
                return end
            if at == edge and found.share <= 1.0:  # what a bound of the search holds grows, and not what the data do
                return (
                    float(self.limits[i][1 if sign > 0 else 0])
                    if found.leans
                    else self._beyond(i, sign, found.share, end)
                )
            if self.left <= 0:
                break
            if outside is not None and self._near(i, inside, outside):
                if not self._cliff(inside, outside) or (outside.held and self._beyond_bounds(i, inside)):
                    break
                if again is None or outside.at != again.at:  # a refit from far away may have ended in another valley
                    again, at, start, outside = outside, outside.at, None, None
                    continue
                if not self._beyond_bounds(i, inside):
                    break
            at, start = self._next(here, edge, inside, outside), None
            at = inside.at + sign * min(abs(at - inside.at), longest)
        if outside is not None:
            limit = float(self.limits[i][1 if sign > 0 else 0])
            if outside.held and not self._close(i, sign, inside, outside):
                return limit  # a refit that was lost far away is held there, too
            lowest = self.beyond_room(i, outside)
            if lowest < ALIKE[0]:
                return limit
            if lowest <= 1.0:
                return self.value(i, outside.at)
            near = self._near(i, inside, outside)
            if inside.leans and self._beyond_bounds(i, inside) and not near:
                return self._farther(i, sign, inside)  # what holds it so far out is a bound of the room
            if near:
                inside, outside = self._narrowed(i, inside, outside)
            between = (near or inside.share > 0.25) and not self._cliff(inside, outside)
            return self.value(i, self._between(inside, outside) if between else outside.at)
        return self._unstopped(i, sign, inside, end)

    def _unstopped(self, i: int, sign: float, inside: Place, end: float) -> float:
        """Where a range ends that was left before the data stopped it: at the linear end, or nowhere once it was found
        beyond that.

        A wide linear end to which no refit came is no end: the problem may be curved.
        """
        limit = float(self.limits[i][1 if sign > 0 else 0])
        narrow = abs(end - self.linear.values[i]) <= WIDE * self.linear.size[i]
        if inside.point is self.z:  # nothing was found out
            return end if narrow else limit
        reached = self.value(i, inside.at)
        if self._beyond_bounds(i, inside) and inside.share < 0.5:
            return limit  # far, and nothing has stopped it yet
        if sign * (reached - end) <= 0.0:
            return end if narrow or not (inside.share < ENOUGH or inside.leans) else limit
        # a bound of the search stopped it there, and not the data
        return self._farther(i, sign, inside) if inside.share < 0.5 or inside.leans else reached

    def _farther(self, i: int, sign: float, inside: Place) -> float:
        """Where a range ends that a bound of the search stopped at a place `inside`: nowhere, but where the data stop
        it a little farther out, wherever the coordinates on bounds may go.

        Only where all of that is short beside the value: elsewhere parameters that grow together without end may look
        alike. A refit that was led there from far away may have lost a valley, so that a place that is stopped is
        looked for beside one that is not.
        """
        here, edge, limit = float(self.z[i]), 0.0 if sign < 0 else 1.0, float(self.limits[i][1 if sign > 0 else 0])
        value = float(self.linear.values[i])
        reach = abs(self.value(i, inside.at) - value)
        last = min(FARTHER * reach, WIDE * float(self.linear.size[i]))
        if last < 2.0 * reach:
            return limit
        at, outside = self.cube(i, value + sign * last, edge), None
        for _ in range(PROBES):
            self.left = max(self.left, 2 * STEPS)
            found = self.grown(i, at, self.predicted(i, inside, at)) if at != inside.at else None
            if found is None or (found.share > 1.0 and not found.settled):
                return limit
            if found.stopped:
                outside = found
            else:
                inside = found if found.share <= 1.0 else replace(found, share=1.0)
            if outside is None:
                return limit
            if abs(outside.at - inside.at) <= NEAR * abs(outside.at - here):
                return self.value(i, outside.at)
            at = self._next(here, edge, inside, outside)
        return limit

    def _near(self, i: int, inside: Place, outside: Place) -> bool:
        """Whether both places are near each other beside their way from the answer."""
        return abs(outside.at - inside.at) <= NEAR * abs(outside.at - float(self.z[i]))

    @staticmethod
    def _cliff(inside: Place, outside: Place) -> bool:
        """Whether the growth beyond the last place inside is steeper than that of a parabola by far, as it is where a
        refit was lost."""
        return outside.share > CLIFF * inside.share

    def _narrowed(self, i: int, inside: Place, outside: Place) -> tuple[Place, Place]:
        """The last place inside and the first outside, nearer to each other where the cost is a wall between them."""
        for _ in range(NARROWED):
            if not self._cliff(inside, outside):
                break
            self.left, at = max(self.left, 2 * STEPS), 0.5 * (inside.at + outside.at)
            found = self.grown(i, at, self.predicted(i, inside, at), ENOUGH, partial(self.straight, i, inside, at))
            if found is None or (found.share > 1.0 and not (found.settled and found.limited and found.share <= LOST)):
                break
            inside, outside = (found, outside) if found.share <= 1.0 else (inside, found)
            if found.share <= 1.0:
                self.met.append(found.point)
        return inside, outside

    def _agreed(self, i: int, inside: Place, one: Place, other: Place) -> bool:
        """Whether two refits at one place, near to the last one inside also by its value, cost the same, so that both
        are the least there: not far above the threshold, where one that is lost is as flat."""
        value, last, here = self.value(i, other.at), self.value(i, inside.at), float(self.linear.values[i])
        alike = abs(one.share - other.share) <= SAME * other.share and other.share <= AGREED
        return alike and not one.leans and abs(value - last) <= NEAR * abs(value - here)

    def _close(self, i: int, sign: float, inside: Place, outside: Place) -> bool:
        """Whether an end that lies between both places is found well enough, also by its distance from a physical
        limit."""
        limit = float(self.limits[i][1 if sign > 0 else 0])
        last, next_one = (abs(self.value(i, p.at) - limit) for p in (inside, outside))
        apart = abs(outside.at - inside.at) <= CLOSE * abs(outside.at - float(self.z[i]))
        return apart and (not np.isfinite(limit) or last <= NEARER * next_one)

    def _beyond_bounds(self, i: int, place: Place) -> bool:
        """Whether coordinate i has left the bounds of the search."""
        return not 0.0 <= float(self.room.outer(place.point)[i]) <= 1.0

    def _next(self, here: float, edge: float, inside: Place, outside: Place | None) -> float:
        """The place to try next."""
        if outside is not None:
            low, high = inside.at, outside.at
            # a cliff, or a refit that found no way: no parabola
            off = 0.35 if outside.share > 10.0 and inside.share < 0.1 else 0.1
            first, last = sorted((low + off * (high - low), high - off * (high - low)))
            return min(max(self._between(inside, outside), first), last)
        factor = float(np.clip(1.1 / np.sqrt(max(inside.share, SLIGHT)), 1.3, 4.0))
        at = here + factor * (inside.at - here)
        return edge if abs(at - here) >= 0.7 * abs(edge - here) else at

    @staticmethod
    def _between(inside: Place, outside: Place) -> float:
        """Where the growth passes the threshold, its root linear as it is for a parabola."""
        low, high = np.sqrt(max(inside.share, 0.0)), np.sqrt(outside.share)
        return float(inside.at + (1.0 - low) / max(high - low, 1e-12) * (outside.at - inside.at))

    def _beyond(self, i: int, sign: float, share: float, end: float) -> float:
        """Where a range ends that goes on to the edge of the box: by the growth there, as far as it says anything.

        Logarithms may say an end far outside, where nothing is known.
        """
        limit = self.limits[i][1 if sign > 0 else 0]
        if share <= SLIGHT:
            return float(limit)
        edge, whole = 0.0 if sign < 0 else 1.0, self.z.copy()
        whole[i] += (edge - self.z[i]) / np.sqrt(share)
        reached, value = float(self.room.extended(whole)[i]), self.linear.values[i]
        last = self.value(i, edge)
        if abs(reached - value) > OUTSIDE * abs(last - value) or (
            self.problem.space.log[i] and reached < last / OUTSIDE
        ):
            return float(limit)
        end = reached if np.isfinite(reached) else end
        return float(np.clip(end, *self.limits[i]))
