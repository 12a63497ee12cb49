"""What additions do to a recorded input, or to a simulated output with its derivatives: plain arrays over the samples of a recording."""

import numpy as np
from scipy.linalg import solve_banded


def late(t: np.ndarray, u: np.ndarray, delay: float, held: bool) -> np.ndarray:
    """u(t - delay) (n,) of an input; of a held one its mean over each interval between samples, so that its integral is exact."""
    if delay <= 0:
        return u
    if not held:
        return np.interp(t - delay, t, u)
    ends = np.r_[t, t[-1] + (t[-1] - t[-2])]
    total = np.r_[0.0, np.cumsum(u * np.diff(ends))]
    at = ends - delay
    summed = np.interp(at, ends, total) + np.minimum(at - t[0], 0.0) * u[0]
    return np.diff(summed) / np.diff(ends)


def lagged(t: np.ndarray, u: np.ndarray, tau: float, held: bool) -> np.ndarray:
    """A lag of first order (n,) that begins at u; of a held input its mean over each interval."""
    h = np.r_[np.diff(t), t[-1] - t[-2]]
    if not held:
        return behind(t, u[:, None], tau)[:, 0]
    decay = np.exp(-h / tau)
    state = _recursion(decay[:-1], (1.0 - decay[:-1]) * u[:-1], u[0])
    return u + (state - u) * (1.0 - decay) * tau / h


def behind(t: np.ndarray, y: np.ndarray, tau: float) -> np.ndarray:
    """A lag of first order behind signals y (n, k) that move in straight lines; it begins at y."""
    h = np.diff(t)[:, None]
    decay = np.exp(-h / tau)
    slope = np.diff(y, axis=0) / h
    # the answer to a straight line: y - slope tau behind it, and what the beginning left dies out
    goal_begin, goal_end = y[:-1] - slope * tau, y[1:] - slope * tau
    return np.stack([_recursion(decay[:, 0], goal_end[:, k] - decay[:, 0] * goal_begin[:, k], y[0, k]) for k in range(y.shape[1])], axis=1)


def _recursion(decay: np.ndarray, gain: np.ndarray, first: float) -> np.ndarray:
    """x[k + 1] = decay[k] x[k] + gain[k], decay in [0, 1]: forward substitution in a matrix of two bands."""
    bands = np.stack([np.ones(len(decay) + 1), np.r_[-decay, 0.0]])
    return solve_banded((1, 0), bands, np.r_[first, gain])


def dead_zone(u: np.ndarray, d: float) -> np.ndarray:
    """Nearer to zero by d, zero inside."""
    return u - np.clip(u, -d, d)


def played(u: np.ndarray, gap: float) -> np.ndarray:
    """u through play of `gap` to each side, beginning at u."""
    z, last = np.empty_like(u), float(u[0])
    for k, v in enumerate(u.tolist()):
        last = min(max(last, v - gap), v + gap)
        z[k] = last
    return z
