"""Standard errors at an answer, from the exact Jacobian, sound when residuals are autocorrelated."""

from dataclasses import dataclass

import numpy as np

BOX_PRECISION = 12.0  # 1 / variance of a uniform variable over the unit cube's edge
SHORT = 10  # samples below which no correlation is estimated


@dataclass(frozen=True)
class Block:
    """Residuals of one output in one recording in order of time: rows of the Jacobian and sample numbers (m,)."""

    rows: slice
    index: np.ndarray


def covariance(jacobian: np.ndarray, residuals: np.ndarray, blocks: list[Block], free: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the cube coordinates by the sandwich estimator, with the box as prior.

    The long-run covariance of the influences (J'J)^-1 J_t r_t with Bartlett weights (Newey and West,
    Econometrica 55 (1987) 703, eq. 5), prewhitened because slow residuals otherwise make intervals
    too short. The uniform prior keeps flat directions finite: their standard error then is that of
    the box, 0.29.
    Coordinates not `free` (held at a bound) get zero rows and columns.
    """
    d = jacobian.shape[1]
    result = np.zeros((d, d))
    active = np.flatnonzero(free)
    if len(active) == 0:
        return result
    j = jacobian[:, active]
    degrees = max(1, len(residuals) - len(active))
    variance = max(float(residuals @ residuals) / degrees, np.finfo(float).tiny)
    hessian = j.T @ j / variance
    prior = BOX_PRECISION * np.eye(len(active))
    bread = np.linalg.inv(hessian + prior)
    spread = bread @ prior @ bread
    for block in blocks:
        # what every residual does to every estimate: in these series nearly parallel columns of the
        # Jacobian have cancelled already, so that each may be filtered by its own memory
        influence = (j[block.rows] * residuals[block.rows, None]) @ bread / variance
        spread += prewhitened_long_run(influence, block.index) * len(residuals) / degrees
    result[np.ix_(active, active)] = spread
    return 0.5 * (result + result.T)


def prewhitened_long_run(scores: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Long-run sum of outer products of scores (m, d) at sample numbers `index` (m,), missing samples counting as zero.

    Every column is filtered by its own AR(1), summed, and recoloured (Andrews and Monahan,
    Econometrica 60 (1992) 953, eqs. 2.2 to 2.4, with a diagonal AR matrix). Negative correlation is
    left to the kernel, and 0.97 bounds the factor that recolouring may add.
    """
    spread = np.zeros((int(index[-1] - index[0]) + 1, scores.shape[1]))
    spread[index - index[0]] = scores
    if len(index) < SHORT:
        return spread.T @ spread
    memory = np.clip(first_correlation(spread), 0.0, 0.97)
    white = spread - memory * np.vstack([spread[:1], spread[:-1]])
    return long_run(white, bandwidth(white)) / np.outer(1.0 - memory, 1.0 - memory)


def first_correlation(series: np.ndarray) -> np.ndarray:
    """AR(1) coefficient (d,) of every column of (n, d); 0 for a column of zeros."""
    power = np.sum(series**2, axis=0)
    return np.divide(np.sum(series[1:] * series[:-1], axis=0), power, out=np.zeros_like(power), where=power > 0)


def bandwidth(series: np.ndarray) -> int:
    """Lags of the Bartlett kernel for columns (n, d) taken as AR(1): 1.1447 (a n)^(1/3), a = mean of 4 rho^2 / (1 - rho^2)^2.

    Andrews, Econometrica 59 (1991) 817, eqs. 6.2 and 6.4, columns weighted by 1 / variance^2.
    """
    n = len(series)
    rho = np.clip(first_correlation(series), -0.97, 0.97)
    a = float(np.mean(4.0 * rho**2 / (1.0 - rho**2) ** 2))
    return int(min(np.ceil(1.1447 * (a * n) ** (1.0 / 3.0)), n // 4))


def long_run(series: np.ndarray, lags: int) -> np.ndarray:
    """Sum over all pairs of rows at most `lags` apart of Bartlett weight x outer product; series (n, d)."""
    total = series.T @ series
    for lag in range(1, min(lags, len(series) - 1) + 1):
        cross = series[lag:].T @ series[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return total
