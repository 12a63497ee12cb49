"""Bounded least squares on some rows of a problem and the bends of its tables, from a point near the answer."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.local.separable import Block
from plantfit.problem.evaluate.smoothing import Smoothing
from plantfit.problem.evaluate.triangle import triangle
from plantfit.problem.problem import Problem

STEPS, TOLERANCE, DAMPING = 40, 1e-9, 1e-5


class Rows:
    """The data's rows of a problem at cube points; recordings that share no coordinate stay apart, all others are
    one group."""

    def __init__(self, problem: Problem):
        self.problem = problem.unsmoothed
        self._last: tuple[bytes, list[tuple[np.ndarray, np.ndarray]]] = b"", []

        self.places = self.problem.block_places
        self.groups = list(self.problem.separable or [np.arange(self.problem.space.dimension)])

    def blocks(self, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Residuals (m_k,) and derivatives (m_k, q) of every block of rows; the last point is remembered."""
        if self._last[0] != z.tobytes():
            made = self.problem.compiled["blocks"](z, self.problem.arguments)
            self._last = z.tobytes(), [(np.asarray(r), np.asarray(j)) for r, j in made]
        return self._last[1]

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Scaled residuals (m,) in the order of the problem."""
        return np.asarray(self.problem.residuals(z))

    def normal_matrix(self, z: np.ndarray) -> np.ndarray:
        """J'J (d, d)."""
        total = np.zeros((self.problem.space.dimension,) * 2)
        for (_, jacobian), (own, _) in zip(self.blocks(z), self.places, strict=True):
            total[np.ix_(own, own)] += jacobian.T @ jacobian
        return total

    def at(
        self, z: np.ndarray, smoothing: Smoothing | None, keep: np.ndarray | None
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """For every group residuals (k,) and derivatives (k, q) of the rows `keep` (m,), all if None, in few rows,
        then of bends."""
        parts = []
        for (r, jacobian), (own, place) in zip(self.blocks(z), self.places, strict=True):
            kept = slice(None) if keep is None else keep[place]
            parts.append((triangle(jacobian[kept], r[kept]), own))
        members = [[part] for part in parts] if len(self.groups) > 1 else [parts]
        bends, slopes = smoothing.weighted(z) if smoothing else (np.zeros(0), np.zeros((0, len(z))))
        made = []
        for own, rows in zip(self.groups, members, strict=True):
            here = np.any(slopes[:, own] != 0, axis=1)
            r, j = [small[:, -1] for small, _ in rows], [np.zeros((len(small), len(own))) for small, _ in rows]
            for (small, columns), matrix in zip(rows, j, strict=True):
                matrix[:, np.searchsorted(own, columns)] = small[:, :-1]
            made.append((np.concatenate([*r, bends[here]]), np.vstack([*j, slopes[np.ix_(here, own)]])))
        return made


def descend(
    rows: Rows, smoothing: Smoothing | None, z: np.ndarray, keep: np.ndarray | None = None, most: int = STEPS
) -> np.ndarray:
    """The point (d,) where the sum of squares of rows `keep` and bends is least, from z by bounded
    Levenberg-Marquardt, `most` steps."""
    z = np.clip(np.asarray(z, dtype=float), 0.0, 1.0)
    start = rows.at(z, smoothing, keep)
    searches = [Block(own, z[own], r, j, TOLERANCE, DAMPING) for own, (r, j) in zip(rows.groups, start, strict=True)]
    for _ in range(most):
        if all(s.done for s in searches):
            break
        trial, steps = z.copy(), []
        for s in searches:
            step, promised = (np.zeros(len(s.own)), 0.0) if s.done else s.step()
            steps.append((step, promised))
            trial[s.own] = np.clip(s.x + step, 0.0, 1.0)
        for s, (step, promised), (r, j) in zip(searches, steps, rows.at(trial, smoothing, keep), strict=True):
            if not s.done:
                s.update(step, promised, r, j)
        for s in searches:
            z[s.own] = s.x
    return z
