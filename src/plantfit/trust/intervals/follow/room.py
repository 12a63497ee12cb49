"""Where ranges are followed: the box of the search and some way beyond it, as far as physics and the simulation
allow."""

from dataclasses import dataclass, replace

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem

FACTOR = 30.0  # times beyond a bound on a logarithmic scale
WIDTHS = 2.0  # widths of the box beyond a bound on a linear one
OFF = 1e-3  # of the way from a physical limit to the bound: no range is followed nearer to the limit
FAR = 1e300  # in place of no limit, so that nothing is subtracted from infinity


@dataclass(frozen=True)
class Room:
    """A cube w of its own over coordinates z = first + width w of the problem's; (d,) each. Values lie from `lower` to
    `upper` in it.

    A bound of the search says nothing about a parameter. Where others keep its partners in their bounds, its range ends
    there and not where the data end it.
    """

    problem: Problem
    first: np.ndarray
    width: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, problem: Problem) -> "Room":
        """A dead time ends at its upper bound, for which the past was kept."""
        space, model = problem.space, problem.model
        least, most = np.array([c.limits for c in space.coordinates]).reshape(-1, 2).T
        beyond = WIDTHS * (space.upper - space.lower)
        lower = np.where(space.log, space.lower / FACTOR, space.lower - beyond)
        upper = np.where(space.log, space.upper * FACTOR, space.upper + beyond)
        late = {d.parameter for d in (*getattr(model, "delays", ()), *getattr(model, "state_delays", ()))}
        kept = np.array([c.parameter in late for c in space.coordinates], dtype=bool)
        # at a physical limit outside of the bounds a plant may be none, as one without a mass: refits would stick there
        nearest = np.where(np.isfinite(least), least + OFF * (space.lower - np.maximum(least, -FAR)), -np.inf)
        farthest = np.where(np.isfinite(most), most - OFF * (np.minimum(most, FAR) - space.upper), np.inf)
        lower = np.where(least < space.lower, np.maximum(lower, nearest), space.lower)
        upper = np.where((most > space.upper) & ~kept, np.minimum(upper, farthest), space.upper)
        first, last = space.cube(lower), space.cube(upper)
        first, last = np.where(lower == space.lower, 0.0, first), np.where(upper == space.upper, 1.0, last)
        return cls(problem, first, last - first, lower, upper)

    def wider(self, i: int) -> "Room":
        """A room that reaches farther for all coordinates but i, wherever this one reaches beyond the bounds: `FACTOR`
        times as near to a physical limit, else as many times as far."""
        space = self.problem.space
        least, most = np.array([c.limits for c in space.coordinates]).reshape(-1, 2).T
        width, moved = self.upper - self.lower, np.arange(len(self.first)) != i
        with np.errstate(invalid="ignore", over="ignore"):
            down = np.where(space.log, self.lower / FACTOR, self.lower - FACTOR * width)
            up = np.where(space.log, self.upper * FACTOR, self.upper + FACTOR * width)
            down = np.fmax(down, least + (self.lower - least) / FACTOR)
            up = np.fmin(up, most - (most - self.upper) / FACTOR)
        below, above = moved & (self.lower < space.lower), moved & (self.upper > space.upper)
        lower, upper = np.where(below, down, self.lower), np.where(above, up, self.upper)
        first, last = space.cube(lower), space.cube(upper)
        first, last = np.where(below, first, self.first), np.where(above, last, self.first + self.width)
        return replace(self, first=first, width=last - first, lower=lower, upper=upper)

    def inner(self, z: np.ndarray) -> np.ndarray:
        """Points (..., d) of the problem's cube in this one."""
        return (np.asarray(z, dtype=float) - self.first) / self.width

    def outer(self, w: np.ndarray) -> np.ndarray:
        """Points (..., d) of this cube in the problem's, some of them outside of it."""
        return self.first + self.width * np.asarray(w, dtype=float)

    def physical(self, w: np.ndarray) -> np.ndarray:
        """Values (..., d) in their units, at most at the ends of the room: rounding is no value below zero."""
        return np.clip(self.extended(w), self.lower, self.upper)

    def extended(self, w: np.ndarray) -> np.ndarray:
        """Values (..., d) in their units, of points that may lie outside of the room."""
        with np.errstate(over="ignore"):
            return np.asarray(self.problem.space.physical(self.outer(w)))

    def cube(self, values: np.ndarray) -> np.ndarray:
        """The point (..., d) of values in their units."""
        return self.inner(self.problem.space.cube(values))

    def slopes(self, w: np.ndarray) -> np.ndarray:
        """Derivative (d,) of each value by its own coordinate at a point (d,)."""
        return self.problem.space.slopes(self.outer(w)) * self.width
