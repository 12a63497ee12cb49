"""Standard errors at an answer, from the exact Jacobian, sound when residuals are autocorrelated."""

from dataclasses import dataclass

import numpy as np

BOX_PRECISION = 12.0  # 1 / variance of a uniform variable over the unit cube's edge


@dataclass(frozen=True)
class Block:
    """Residuals of one output in one recording in order of time: rows of the Jacobian and sample numbers (m,)."""

    rows: slice
    index: np.ndarray


def covariance(jacobian: np.ndarray, residuals: np.ndarray, blocks: list[Block], free: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the cube coordinates by the sandwich estimator, with the box as prior.

    Bread: the Gauss-Newton Hessian J'J. Meat: the long-run covariance of the scores J_t r_t with
    Bartlett weights (Newey and West, Econometrica 55 (1987) 703, eq. 5) and a bandwidth by
    Andrews, Econometrica 59 (1991) 817, eqs. 6.2 and 6.4 for an AR(1) residual. The uniform prior
    keeps flat directions finite: their standard error then is that of the box, 0.29.
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
    meat = np.zeros_like(hessian)
    for block in blocks:
        meat += long_run(j[block.rows] * residuals[block.rows, None], bandwidth(residuals[block.rows], block.index), block.index)
    meat *= len(residuals) / degrees / variance**2
    prior = BOX_PRECISION * np.eye(len(active))
    bread = np.linalg.inv(hessian + prior)
    result[np.ix_(active, active)] = bread @ (meat + prior) @ bread
    return 0.5 * (result + result.T)


def bandwidth(residuals: np.ndarray, index: np.ndarray) -> int:
    """Lags of the Bartlett kernel for an AR(1) residual: 1.1447 (a n)^(1/3), a = 4 rho^2 / (1 - rho^2)^2."""
    n = len(residuals)
    together = np.flatnonzero(np.diff(index) == 1)
    if n < 10 or len(together) < 5:
        return 0
    centred = residuals - residuals.mean()
    power = float(np.mean(centred**2))
    if power == 0.0:
        return 0
    rho = float(np.clip(np.mean(centred[together] * centred[together + 1]) / power, 0.0, 0.99))
    a = 4.0 * rho**2 / (1.0 - rho**2) ** 2
    return int(min(np.ceil(1.1447 * (a * n) ** (1.0 / 3.0)), n // 4))


def long_run(scores: np.ndarray, lags: int, index: np.ndarray) -> np.ndarray:
    """Sum over all pairs at most `lags` samples apart of Bartlett weight x outer product; scores (m, d)."""
    spread = np.zeros((int(index[-1] - index[0]) + 1, scores.shape[1]))
    spread[index - index[0]] = scores  # missing samples count as zero
    total = spread.T @ spread
    for lag in range(1, min(lags, len(spread) - 1) + 1):
        cross = spread[lag:].T @ spread[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return total
