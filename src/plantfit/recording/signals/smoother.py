"""Kalman (Rauch-Tung-Striebel) smoothing on the recorded time stamps, even or not.

The signal is m-fold integrated white noise of spectral density q, measured with white noise of standard deviation r:

    x' = (x2, ..., xm, w),    E w(t) w(s) = q delta(t - s),    y_k = x1(t_k) + e_k                             (1)

Its smoother is found from the banded normal equations of all states at once, which gives what the forward and backward
recursions of Rauch, Tung and Striebel give (AIAA Journal 3, 1965), in the form of Bell, SIAM J. Optimization 4 (1994).
For m = 2 and 3 it is the cubic and the quintic smoothing spline (Wahba, J. Royal Statistical Society B 40, 1978). With
even steps h, away from the ends, it is a zero-phase Butterworth filter of order m,

    1/(1 + (f/fc)^(2m)),    (2 pi fc)^(2m) = q/(r^2 h)                                                         (2)
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import factorial
from typing import Any, Literal

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from plantfit.errors import RecordingError

_TRUST = 1e-10  # precision of the unknown first state, relative to what one sample tells
_FLATTEST = 1e-13  # least (2 pi fc h)^(2m) that float64 solves


@dataclass(frozen=True)
class Smoothed:
    """Signal and derivatives (n, m) at the samples, in its unit and seconds; the rms `noise` taken away; the
    `cutoff` in Hz of eq. (2)."""

    states: np.ndarray
    noise: float
    cutoff: float


def kalman_smoother(
    t: np.ndarray,
    values: np.ndarray,
    cutoff: float | Literal["likelihood", "gcv"] = "likelihood",
    noise: float | None = None,
    order: int = 3,
) -> Smoothed:
    """Smooth values (n,) at increasing times t (n,) by eq. (1) with m = `order`.

    `cutoff` in Hz, or that of the largest likelihood (at `noise`, in the signal's unit, if that is known), or that of
    generalised cross-validation (Craven, Wahba, Numerische Mathematik 31, 1979). Raises RecordingError for fewer than 2
    m + 1 samples and for a cut-off too far below the sampling rate.
    """
    if len(values) < 2 * order + 1:
        raise RecordingError(
            f"Kalman smoothing of order {order} needs {2 * order + 1} samples, not {len(values)}; use a longer stretch."
        )
    system = _System(np.asarray(t, dtype=float), np.asarray(values, dtype=float), order)
    if isinstance(cutoff, str):
        cutoff = system.best(
            partial(_likelihood, system, noise) if cutoff == "likelihood" else partial(_cross_validation, system)
        )
    elif cutoff < system.lowest:
        raise RecordingError(
            f"Kalman smoothing at {cutoff:g} Hz is ill-conditioned at {1 / system.h:g} samples "
            f"a second; decimate the recording first or give at least {system.lowest:.2g} Hz."
        )
    at = system.solve(cutoff)
    return Smoothed(at.states, float(np.sqrt(np.mean((at.states[:, 0] - values) ** 2))), float(cutoff))


def _likelihood(system: "_System", noise: float | None, cutoff: float) -> float:
    """Minus twice the log-likelihood but for a constant; the noise profiled out unless given."""
    at = system.solve(cutoff)
    free = system.n - system.m  # the unknown first state takes m
    return (free * np.log(at.squares) if noise is None else at.squares / noise**2) + at.log_determinant


def _cross_validation(system: "_System", cutoff: float) -> float:
    """Logarithm of the residual's mean square over the squared share of its degrees of freedom."""
    nearby = 1e-3  # of the logarithm of q: the derivative of the log-determinant by it is the trace of the filter
    low, at, high = (system.solve(cutoff * np.exp(k * nearby / (2 * system.m))) for k in (-1, 0, 1))
    freedom = system.n - system.m - (high.log_determinant - low.log_determinant) / (2 * nearby)
    residual = float(np.sum((at.states[:, 0] - system.y - system.middle) ** 2))
    return np.log(residual) - 2 * np.log(freedom) if residual > 0 and freedom > 0 else np.inf


@dataclass(frozen=True)
class _Solution:
    states: np.ndarray  # (n, m)
    squares: float  # of measurement errors and driving noise, each by its size
    log_determinant: float  # of the covariance of all samples (r = 1)


class _System:
    """The normal equations in steps of the median period h, states scaled by powers of h: (r^2 = 1, ratio = q
    h^(2m-1)/r^2)."""

    def __init__(self, t: np.ndarray, values: np.ndarray, m: int):
        self.m, self.n = m, len(t)
        self.h = float(np.median(np.diff(t)))
        self.middle = float(np.mean(values))
        self.y = values - self.middle
        steps = np.diff(t) / self.h
        i, j = np.indices((m, m))
        powers = np.array([factorial(k) for k in range(2 * m)], dtype=float)
        self.ahead = ahead = np.where(
            j >= i, steps[:, None, None] ** np.maximum(j - i, 0) / powers[np.maximum(j - i, 0)], 0.0
        )
        a, b = m - 1 - i, m - 1 - j
        spread = steps[:, None, None] ** (a + b + 1) / ((a + b + 1) * powers[a] * powers[b])
        self.inverse = inverse = np.linalg.inv(spread)
        self.log_spread = float(np.sum(np.linalg.slogdet(spread)[1]))
        across = -np.swapaxes(ahead, 1, 2) @ inverse
        self.own = np.zeros((self.n, m, m))
        self.own[1:] += inverse
        self.own[:-1] += -across @ ahead
        self.across = np.swapaxes(across, 1, 2)  # block (k + 1, k)

    def ratio(self, cutoff: float) -> float:
        return (2 * np.pi * cutoff * self.h) ** (2 * self.m)

    @property
    def lowest(self) -> float:
        """The lowest cut-off (Hz) that can be solved."""
        return _FLATTEST ** (0.5 / self.m) / (2 * np.pi * self.h)

    def solve(self, cutoff: float) -> _Solution:
        m, n, ratio = self.m, self.n, self.ratio(cutoff)
        bands = np.zeros((2 * m, n, m))
        own, across = self.own / ratio, self.across / ratio
        own[:, 0, 0] += 1.0
        for i in range(m):
            for j in range(m):
                if i >= j:
                    bands[i - j, :, j] = own[:, i, j]
                bands[m + i - j, :-1, j] = across[:, i, j]
        bands[0, 0] += _TRUST
        factor = cholesky_banded(bands.reshape(2 * m, n * m), lower=True)
        right = np.zeros((n, m))
        right[:, 0] = self.y
        x = cho_solve_banded((factor, True), right.ravel()).reshape(n, m)
        driven = x[1:] - np.einsum("kij,kj->ki", self.ahead, x[:-1])
        squares = np.sum((self.y - x[:, 0]) ** 2) + np.einsum("ki,kij,kj->", driven, self.inverse, driven) / ratio
        # det(covariance of y) = det(precision of the states given y) / det(prior precision), by Sylvester's identity
        log_determinant = (
            2 * float(np.sum(np.log(factor[0]))) + (n - 1) * m * np.log(ratio) + self.log_spread - m * np.log(_TRUST)
        )
        x[:, 0] += self.middle
        return _Solution(x / self.h ** np.arange(m), float(squares), log_determinant)

    def best(self, cost: Callable[[float], float]) -> float:
        """The cut-off (Hz) of the least cost."""
        low, high = max(0.5 / (self.h * self.n), self.lowest), 0.5 / self.h
        grid = np.linspace(np.log(low), np.log(high), 25)
        best = int(np.argmin([cost(float(np.exp(v))) for v in grid]))
        ends = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        found: Any = minimize_scalar(
            lambda v: cost(float(np.exp(v))), bounds=ends, method="bounded", options={"xatol": 1e-3}
        )
        return float(np.exp(found.x))
