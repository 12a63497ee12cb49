"""Lower bound on a least-squares problem over a convex set, by Lagrange's dual at a point near the minimum."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, nnls

NEAR = 1e-6  # constraints closer than this may carry a multiplier


@dataclass(frozen=True)
class ConvexProblem:
    """min |rows v - target|^2 + rest over least <= v <= most with linear v + offset >= 0 and J - h^2/m >= least
    inertia.

    `cones` holds (place of m, of h, of J, least inertia); m > 0 in the box.
    """

    rows: np.ndarray
    target: np.ndarray
    rest: float
    linear: np.ndarray
    offset: np.ndarray
    cones: tuple[tuple[int, int, int, float], ...]
    least: np.ndarray
    most: np.ndarray

    def value(self, v: np.ndarray) -> tuple[float, np.ndarray]:
        miss = self.rows @ v - self.target
        return float(miss @ miss) + self.rest, 2.0 * self.rows.T @ miss

    def levels(self, v: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [self.linear @ v + self.offset, [v[j] - v[h] ** 2 / v[m] - low for m, h, j, low in self.cones]]
        )

    def slopes(self, v: np.ndarray) -> np.ndarray:
        rows = np.zeros((len(self.cones), len(v)))
        for row, (m, h, j, _) in zip(rows, self.cones, strict=True):
            row[j], row[h], row[m] = 1.0, -2.0 * v[h] / v[m], (v[h] / v[m]) ** 2
        return np.vstack([self.linear, rows])


def lower_bound(problem: ConvexProblem) -> float:
    """A number that no point of the set has a value below.

    For multipliers l >= 0 of concave constraints g >= 0 the Lagrangian f - l g is convex: over the box it is at least
    its tangent at any point (Boyd, Vandenberghe, Convex Optimization, 2004, sections 3.1.3 and 5.1.3). The point is
    scipy's SLSQP's.
    """
    width = problem.most - problem.least
    sizes = np.maximum(np.linalg.norm(problem.slopes(0.5 * (problem.least + problem.most)) * width, axis=1), 1e-300)

    def at(z: np.ndarray) -> np.ndarray:
        return problem.least + width * z

    inner = {
        "type": "ineq",
        "fun": lambda z: problem.levels(at(z)) / sizes,
        "jac": lambda z: problem.slopes(at(z)) * width / sizes[:, None],
    }
    done = minimize(
        lambda z: (problem.value(at(z))[0], problem.value(at(z))[1] * width), np.full(len(width), 0.5), jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * len(width), constraints=[inner], options={"maxiter": 300, "ftol": 1e-14},
    )  # fmt: skip
    return max(_dual(problem, at(np.clip(z, 0.0, 1.0)), width, sizes) for z in (done.x, np.full(len(width), 0.5)))


def _dual(problem: ConvexProblem, v: np.ndarray, width: np.ndarray, sizes: np.ndarray) -> float:
    value, gradient = problem.value(v)
    level, slope = problem.levels(v) / sizes, problem.slopes(v) * width / sizes[:, None]
    gradient = gradient * width
    z = (v - problem.least) / width
    eye = np.eye(len(v))
    near = np.flatnonzero(level <= NEAR)
    edges = np.vstack([eye[z <= NEAR], -eye[z >= 1.0 - NEAR]])
    columns = np.vstack([slope[near], edges])
    multipliers = nnls(columns.T, gradient)[0][: len(near)] if len(columns) else np.zeros(0)
    left = gradient - slope[near].T @ multipliers
    return value - float(multipliers @ level[near]) + float(np.sum(np.minimum(-left * z, left * (1.0 - z))))
