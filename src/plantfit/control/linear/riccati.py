"""Gains of the discrete Riccati equation: the regulator of least quadratic cost, and its dual, the steady-state
Kalman filter."""

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are


def regulator_gain(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Gain K (m, n) and cost-to-go P (n, n) for x+ = a x + b u, u = -K x, least sum of x'q x + u'r u; None where none
    holds the plant.

    Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., section 9.3.
    """
    try:
        p = solve_discrete_are(a, b, q, r)
        gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        # the solver may return a cost that holds nothing
        slowest = np.abs(np.linalg.eigvals(a - b @ gain)).max()
    except (LinAlgError, ValueError):
        return None
    return (gain, p) if slowest < 1.0 else None


def filter_gain(a: np.ndarray, c: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray | None:
    """Gain L (n, p) of the corrected estimate x + L (y - c x), process noise q (n, n), measurement noise r (p, p); None
    where none exists.

    Source: Anderson, Moore, Optimal Filtering, section 4.4 (eq. 4.4 - 4.6).
    """
    found = regulator_gain(a.T, c.T, q, r)
    if found is None:
        return None
    spread = found[1]
    return np.linalg.solve(c @ spread @ c.T + r, c @ spread).T
