"""What additions do to a recorded input, or to a simulated output with its derivatives: plain arrays over the
samples of a recording."""

import numpy as np
from scipy.linalg import lapack

# an output (n,), its derivatives (n, d), that by the value of the addition (n,)
Shown = tuple[np.ndarray, np.ndarray, np.ndarray | None]


def late(t: np.ndarray, u: np.ndarray, delay: float, held: bool) -> np.ndarray:
    """u(t - delay) (n,) of an input; of a held one its mean over each interval between samples, so that its integral
    is exact."""
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
    return _recursion(decay[:, 0], goal_end - decay * goal_begin, y[0])


def _recursion(decay: np.ndarray, gain: np.ndarray, first: np.ndarray) -> np.ndarray:
    """x[k + 1] = decay[k] x[k] + gain[k] in columns, decay in [0, 1]: forward substitution in a matrix of two bands."""
    bands = np.stack([np.ones(len(decay) + 1), np.r_[-decay, 0.0]])
    goal = np.concatenate([np.atleast_1d(first)[None], gain.reshape(len(gain), -1)])
    # by LAPACK's routine itself, that a plant that explodes has the outputs before that
    return lapack.dtbtrs(bands, goal, uplo="L", diag="U")[0].reshape(-1, *gain.shape[1:])


def dead_zone(u: np.ndarray, d: float) -> np.ndarray:
    """Nearer to zero by d, zero inside."""
    return u - np.clip(u, -d, d)


def played(u: np.ndarray, gap: float) -> np.ndarray:
    """u through play of `gap` to each side, beginning at u."""
    z, last = np.empty_like(u), float(u[0])
    for k, v in enumerate(u.tolist()):
        if last < v - gap:
            last = v - gap
        elif last > v + gap:
            last = v + gap
        z[k] = last
    return z


def sensor_lag(t: np.ndarray, y: np.ndarray, slopes: np.ndarray, tau: float, scale: float) -> Shown:
    """The output behind a lag of first order; the derivative by tau is left to differences."""
    both = behind(t, np.column_stack([y, slopes]), max(tau, 1e-12))
    return both[:, 0], both[:, 1:], None


def offset(t: np.ndarray, y: np.ndarray, slopes: np.ndarray, size: float, scale: float) -> Shown:
    """The output and a constant."""
    return y + size / scale, slopes, np.full(len(y), 1.0 / scale)


def drift(t: np.ndarray, y: np.ndarray, slopes: np.ndarray, rate: float, scale: float) -> Shown:
    """The output and a straight line in time, zero at t = 0."""
    return y + rate * t / scale, slopes, t / scale


def sensor_high(t: np.ndarray, y: np.ndarray, slopes: np.ndarray, level: float, scale: float) -> Shown:
    """No more than the level."""
    return _ended(y, slopes, y > level / scale, level, scale)


def sensor_low(t: np.ndarray, y: np.ndarray, slopes: np.ndarray, level: float, scale: float) -> Shown:
    """No less than the level."""
    return _ended(y, slopes, y < level / scale, level, scale)


def _ended(y: np.ndarray, slopes: np.ndarray, beyond: np.ndarray, level: float, scale: float) -> Shown:
    return (
        np.where(beyond, level / scale, y),
        np.where(beyond[:, None], 0.0, slopes),
        np.where(beyond, 1.0 / scale, 0.0),
    )
