"""Fit some coordinates anew from a point nearby, the others held."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.local.separable import Block
from plantfit.problem.problem import Problem

REFIT, MOST = 1e-6, 60  # relative decrease of the cost that ends a refit, and steps at most


def refit(problem: Problem, start: np.ndarray, free: np.ndarray, tolerance: float = REFIT) -> tuple[np.ndarray, float]:
    """The best point (d,) near `start` over the coordinates `free` (d,) bool, and its cost times the number of samples.

    Damped Gauss-Newton steps inside the box; one local search, nothing global.
    """
    places, point = np.flatnonzero(free), np.array(start, dtype=float)
    count = sum(problem.parts.counts.values())

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point[places] = x
        r, jacobian = problem.compressed(point)
        scale = np.sqrt(count / len(r))
        return r * scale, jacobian[:, places] * scale

    search = Block(places, point[places].copy(), *at(point[places].copy()), tolerance=tolerance)
    for _ in range(MOST if len(places) else 0):
        step, promised = search.step()
        search.update(step, promised, *at(np.clip(search.x + step, 0.0, 1.0)))
        if search.done:
            break
    point[places] = search.x
    return point, search.cost
