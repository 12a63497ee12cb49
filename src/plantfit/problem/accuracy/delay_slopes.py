"""How exact the slope of the residuals by the dead time of a held input is: steps are cut at the jumps, and samples
are crossed by them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.accuracy.step_errors import halved, residuals_at
from plantfit.problem.problem import Problem
from plantfit.simulate.steps.registry import STEPPERS

OFTEN = 0.1  # jumps a sample from which on the slope by a dead time is looked at
DELAY_SHARE = 1e-5  # of its range, by which a dead time is moved to see a slope


class HeldDelay(NamedTuple):
    """A free dead time of a held input: its coordinate, and the samples and jumps (s) of a recording that it enters."""

    place: int
    t: np.ndarray
    jumps: np.ndarray

    @property
    def often(self) -> bool:
        return len(self.jumps) > OFTEN * len(self.t)

    def bounds_on_samples(self, problem: Problem) -> list[tuple[float, float]]:
        """Bounds (s) at which a jump falls on a sample, with the side (1 or -1) of each that is inside."""
        c = problem.space.coordinates[self.place]
        ends = [(c.lower, 1.0), (c.upper, -1.0)]
        return [
            (b, side)
            for b, side in ends
            if len(self.jumps) and np.any(np.isin(_rounded(self.jumps + b), _rounded(self.t)))
        ]

    def on_samples(self, problem: Problem, z: np.ndarray) -> np.ndarray:
        """The cube points z with the dead time moved, so that jumps fall on samples."""
        c, shifts = problem.space.coordinates[self.place], self.t - self.jumps[0]
        inside = shifts[(shifts > c.lower) & (shifts < c.upper)]
        if not len(inside):
            return z
        own = np.array(problem.space.physical(z))[:, self.place]
        return with_value(problem, z, self.place, inside[np.argmin(np.abs(own[:, None] - inside), axis=1)])


def held_delays(problem: Problem) -> list[HeldDelay]:
    """The free dead times of held inputs, once by parameter."""
    simulator, found = problem.predictor.stepping(), {}
    for channel, delay in enumerate(simulator.vector.model.delays):
        root = problem.space.root(delay.parameter)
        for i, c in enumerate(problem.space.coordinates):
            if c.parameter == root and root not in found and delay.input not in simulator.interpolated:
                drive = problem.data["drive"][c.recording or next(iter(problem.data["drive"]))]
                found[root] = HeldDelay(i, np.asarray(drive.t), np.asarray(drive.delayed[channel].knots))
    return list(found.values())


def slope_error(
    problem: Problem, z: np.ndarray, *, places: Sequence[int], sides: tuple[float, ...] = (1.0, -1.0)
) -> float:
    """Step error of the residuals' slope by these coordinates together at a cube point, from the worse side, as a
    share of the slope."""
    values = np.array(problem.space.physical(z))
    width = DELAY_SHARE * (problem.space.upper - problem.space.lower)[list(places)]
    simulator = problem.predictor.stepping()
    q = 2.0 ** STEPPERS[simulator.stepper].order
    fine = halved(problem)

    def slope(steps: Problem, side: float) -> np.ndarray:
        moved = values.copy()
        moved[list(places)] += side * width
        return side * (residuals_at(steps, problem.space.cube(moved)) - residuals_at(steps, z))

    shares = []
    for side in sides:
        exact = slope(fine, side)
        shares.append(
            np.sqrt(np.mean((slope(problem, side) - exact) ** 2))
            * q
            / (q - 1.0)
            / max(np.sqrt(np.mean(exact**2)), 1e-300)
        )
    return float(np.max(shares))


def with_value(problem: Problem, z: np.ndarray, place: int, value: float | np.ndarray) -> np.ndarray:
    """Cube points z (n, d) with another physical value of one coordinate."""
    values = np.array(problem.space.physical(z))
    values[:, place] = value
    return problem.space.cube(values)


def _rounded(t: np.ndarray) -> np.ndarray:
    return np.round(t, 9)
