"""The linear problem of multiple shooting, eliminated state by state with orthogonal transformations.

Each segment has rows on (its initial states, parameters); continuity couples it to the next. Going through the segments
once, QR removes the states of each and hands what is left to the next, as a square-root information filter does
(Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. V). What remains are a few rows on the
parameters: the condensed problem of Bock (1983), which is solved within the bounds. Unlike a forward recursion it does
not lose digits when the plant is unstable, and costs are linear in the number of segments.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

LEAST_SIZE = 1e-3  # of a column of the condensed problem, as far as damping goes


class Linear(NamedTuple):
    """L segments in scaled states (n) and coordinates of the cube; rows of residuals are (residual | derivatives).

    `rows` (L, k, q + n + 1): derivatives by the q local coordinates, by the initial states, and the residual.
    `end` (L, n, q + n): derivatives of the final states. `gap` (L, n): final states minus initial states of the next
    segment. `joined` (L,): whether the next segment continues this one. `local` (L, q): the coordinates of each
    segment.
    """

    rows: np.ndarray
    end: np.ndarray
    gap: np.ndarray
    joined: np.ndarray
    local: np.ndarray

    @property
    def nodes(self) -> int:
        """Numbers that continuity compares; at least 1."""
        return max(1, int(np.sum(self.joined)) * self.gap.shape[1])

    def merit(self, weight: float, dz: np.ndarray | None = None, ds: np.ndarray | None = None) -> float:
        """Sum of squared residuals plus weight^2 times the mean squared gap, after a step of the linear model."""
        data, gap = self.rows[:, :, -1], self.gap
        if dz is not None and ds is not None:
            step = np.concatenate([dz[self.local], ds], axis=1)
            data = data + np.einsum("lkv,lv->lk", self.rows[:, :, :-1], step)
            gap = gap + np.einsum("lnv,lv->ln", self.end, step) - np.roll(ds, -1, axis=0)
        return float(np.sum(data**2) + weight**2 * np.sum(gap[self.joined] ** 2) / self.nodes)


def step(
    linear: Linear, weight: float, damping: float, z: np.ndarray, *, held: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """The step (d,), (L, n) that minimises the damped linear model with 0 <= z + dz <= 1; `held` keeps z.

    `damping` weighs the squares of the coordinates, each times the size of its column of the condensed problem, and the
    mean square of the states.
    """
    count, n = linear.gap.shape
    q, nodes = linear.local.shape[1], linear.nodes
    soft, hard = np.sqrt(damping / nodes), weight / np.sqrt(nodes)
    carried = np.zeros((0, n + q + 1))
    solved: list[np.ndarray] = []  # per segment (n, n + n + q + 1): states, next states, coordinates, constant
    left: list[np.ndarray] = []
    for i in range(count):
        next_states = np.zeros((n, n))
        own = np.concatenate([linear.rows[i][:, q : q + n], linear.rows[i][:, :q], linear.rows[i][:, -1:]], axis=1)
        own = np.vstack([carried, own, np.hstack([soft * np.eye(n), np.zeros((n, q + 1))])])
        stacked = np.hstack([own[:, :n], np.zeros((len(own), n)), own[:, n:]])
        if linear.joined[i]:
            next_states = -hard * np.eye(n)
            a, b, c = linear.end[i][:, q:], linear.end[i][:, :q], linear.gap[i][:, None]
            # heavy rows first: that is how QR keeps the digits of the light ones
            stacked = np.vstack([np.hstack([hard * a, next_states, hard * b, hard * c]), stacked])
        triangle = _triangle(stacked)
        solved.append(triangle[:n])
        carried = triangle[n:, n:]
        if not linear.joined[i]:
            left.append(_spread(carried[:, n:], linear.local[i], len(z)))
            carried = np.zeros((0, n + q + 1))
    dz = np.zeros_like(z) if held or len(z) == 0 else _bounded(_triangle(np.vstack(left)), z, damping)
    return dz, _states(solved, linear, dz)


def _triangle(rows: np.ndarray) -> np.ndarray:
    """R of the QR decomposition; its rows keep the length of `rows` times any vector."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _spread(rows: np.ndarray, local: np.ndarray, d: int) -> np.ndarray:
    wide = np.zeros((len(rows), d + 1))
    wide[:, local], wide[:, -1] = rows[:, :-1], rows[:, -1]
    return wide


def _bounded(rows: np.ndarray, z: np.ndarray, damping: float) -> np.ndarray:
    sizes = np.maximum(np.linalg.norm(rows[:, :-1], axis=0), LEAST_SIZE)
    rows = np.vstack([rows, np.hstack([np.sqrt(damping) * np.diag(sizes), np.zeros((len(z), 1))])])
    answer = lsq_linear(
        rows[:, :-1], -rows[:, -1], bounds=(np.minimum(-z, 0.0), np.maximum(1.0 - z, 0.0)), method="bvls"
    )
    return np.clip(z + answer.x, 0.0, 1.0) - z


def _states(solved: list[np.ndarray], linear: Linear, dz: np.ndarray) -> np.ndarray:
    """Back substitution, from the last segment to the first."""
    count, n = linear.gap.shape
    ds = np.zeros((count + 1, n))
    for i in reversed(range(count)):
        later = ds[i + 1] if linear.joined[i] else np.zeros(n)
        rows = solved[i]
        right = rows[:, n : 2 * n] @ later + rows[:, 2 * n : -1] @ dz[linear.local[i]] + rows[:, -1]
        ds[i] = solve_triangular(rows[:, :n], -right)
    return ds[:-1]
