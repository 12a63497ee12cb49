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


def normal_matrix(jacobian: np.ndarray, blocks: list[Block]) -> np.ndarray:
    """J'J (d, d), block by block: the parameters of other recordings have columns of zeros there."""
    total = np.zeros((jacobian.shape[1],) * 2)
    for block in blocks:
        rows, columns = _nonzero(jacobian[block.rows])
        total[np.ix_(columns, columns)] += rows.T @ rows
    return total


def box_prior(hessian: np.ndarray) -> np.ndarray:
    """Precision (d, d) of the box along the principal directions of the hessian (d, d).

    Along a unit vector v the cube is 1 / max|v| long, and a uniform variable on that length has the variance
    1 / (12 max|v|^2). Twelve in every direction would let n parameters that move together hide a factor sqrt(n).
    """
    vectors = np.linalg.eigh(hessian)[1]
    return (vectors * BOX_PRECISION * np.max(np.abs(vectors), axis=0) ** 2) @ vectors.T


def _nonzero(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m, d) without their columns of zeros, and the places of the columns kept."""
    columns = np.flatnonzero(np.any(rows != 0.0, axis=0))
    return rows[:, columns], columns


def covariance(jacobian: np.ndarray, residuals: np.ndarray, blocks: list[Block], free: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the cube coordinates by the sandwich estimator, with the box as prior.

    The long-run covariance of the influences (J'J)^-1 J_t r_t with Bartlett weights (Newey and West,
    Econometrica 55 (1987) 703, eq. 5), prewhitened because slow residuals otherwise make intervals
    too short. The uniform prior keeps flat directions finite (see `box_prior`): a standard error is at
    most that of the box, 0.29.
    Coordinates not `free` (held at a bound) get zero rows and columns. One block at a time is worked
    on, so that the memory is that of one recording.
    """
    d = jacobian.shape[1]
    result = np.zeros((d, d))
    active = np.flatnonzero(free)
    if len(active) == 0:
        return result
    j = jacobian[:, active]
    degrees = max(1, len(residuals) - len(active))
    variance = max(float(residuals @ residuals) / degrees, np.finfo(float).tiny)
    hessian = normal_matrix(j, blocks) / variance
    prior = box_prior(hessian)
    bread = np.linalg.inv(hessian + prior)
    spread = bread @ prior @ bread
    for block in blocks:
        # what every residual does to every estimate: in these series nearly parallel columns of the
        # Jacobian have cancelled already, so that each may be filtered by its own memory
        rows, columns = _nonzero(j[block.rows])
        touched = np.flatnonzero(np.any(bread[columns] != 0.0, axis=0))
        influence = (rows * residuals[block.rows, None]) @ bread[np.ix_(columns, touched)] / variance
        spread[np.ix_(touched, touched)] += prewhitened_long_run(influence, block.index) * len(residuals) / degrees
    inside = np.sqrt(np.minimum(1.0, 1.0 / (BOX_PRECISION * np.maximum(np.diag(spread), 1e-300))))
    result[np.ix_(active, active)] = spread * inside[:, None] * inside[None, :]
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
    """Sum over all pairs of rows at most `lags` apart of Bartlett weight x outer product; series (n, d).

    Bartlett weights are how often two rows share a window of lags + 1: the sum is that over all windows
    of the outer product of what they sum to, one matrix product for any number of lags.
    """
    width = lags + 1
    total = np.concatenate([np.zeros((1, series.shape[1])), np.cumsum(series, axis=0)])
    ends = np.arange(1, len(series) + width)
    windows = total[np.minimum(ends, len(series))] - total[np.maximum(ends - width, 0)]
    return windows.T @ windows / width
