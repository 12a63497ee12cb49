"""Fit some coordinates anew from a point nearby, the others held."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.local.separable import Block
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.first_values import FreeStarts

REFIT, MOST = 1e-6, 60  # relative decrease of the cost that ends a refit, and steps at most


def refit(
    problem: Problem, start: np.ndarray, free: np.ndarray, tolerance: float = REFIT, starts: FreeStarts | None = None
) -> tuple[np.ndarray, float]:
    """The best point (d,) near `start` over the coordinates `free` (d,) bool, and its cost times the number of samples.

    Damped Gauss-Newton steps inside the box; one local search, nothing global. `starts` are free beside them.
    """
    places, point = np.flatnonzero(free), np.array(start, dtype=float)
    count = sum(problem.parts.counts.values())

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point[places] = x
        if starts is None:
            r, jacobian = problem.compressed(point)
            scale = np.sqrt(count / len(r))
        else:
            r, jacobian = problem.residuals_and_jacobian(point)
            scale = np.sqrt(count / len(r))
            # rows of smoothing stand behind those of the samples
            r, jacobian = (np.concatenate([starts.left(rows[:count]), rows[count:]]) for rows in (r, jacobian))
        return r * scale, jacobian[:, places] * scale

    search = Block(places, point[places].copy(), *at(point[places].copy()), tolerance=tolerance)
    for _ in range(MOST if len(places) else 0):
        step, promised = search.step()
        search.update(step, promised, *at(np.clip(search.x + step, 0.0, 1.0)))
        if search.done:
            break
    point[places] = search.x
    return point, search.cost
