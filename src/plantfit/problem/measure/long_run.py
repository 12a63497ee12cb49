"""Long-run covariance: what sums of correlated series spread by."""

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

LEVEL = 0.95  # of the intervals whose width allows for few degrees of freedom
NORMAL = 1.959963984540054  # standard deviations of a normal variable to either end of such an interval
ABOVE = 0.1  # chance that a true variance is above the most that its estimate allows
REGRESSORS = 10  # fitted parameters that bias a correlation, at most: not all of many are slow
SHORT = 10  # samples below which no correlation is estimated


def prewhitened_long_run(scores: np.ndarray, index: np.ndarray, fitted: int = 0) -> np.ndarray:
    """Long-run sum of outer products of scores (m, d) at sample numbers `index` (m,), missing samples counting as zero.

    Scores of equal numbers are added first: they share one error.

    Every column is filtered by its own AR(1), summed, and recoloured (Andrews and Monahan,
    Econometrica 60 (1992) 953, eqs. 2.2 to 2.4, with a diagonal AR matrix). Negative correlation is
    left to the kernel, and `most_memory` bounds the factor that recolouring may add. Residuals of `fitted` parameters
    look less correlated than the errors are, which is corrected for (see `unbiased`).
    """
    spread = _in_order(scores, index)
    if len(spread) < SHORT:
        return spread.T @ spread
    white, memory = _prewhitened(spread, fitted)
    return long_run(white, bandwidth(white)) / np.outer(1.0 - memory, 1.0 - memory)


def degrees_of_freedom(scores: np.ndarray, shares: np.ndarray, index: np.ndarray) -> np.ndarray:
    """How many independent errors each variance (d,) of `prewhitened_long_run(scores, index)` rests on: few, where a
    few samples decide.

    `shares` (m, d) are the variances that samples would add if all errors were of one size, w_i. The variance estimated
    with the Bartlett weights K_ij of the kernel has the degrees (sum w_i)^2 / sum K_ij^2 w_i w_j (F. E. Satterthwaite,
    Biometrics Bulletin 2 (1946) 110; for sandwiches R. M. Bell, D. F. McCaffrey, Survey Methodology 28 (2002) 169).
    """
    spread, weights = _in_order(scores, index), _in_order(shares, index)
    lags = bandwidth(_prewhitened(spread, 0)[0]) if len(spread) >= SHORT else 0
    pairs = np.sum(weights**2, axis=0)
    for k in range(1, lags + 1):
        pairs = pairs + 2.0 * (1.0 - k / (lags + 1)) ** 2 * np.sum(weights[:-k] * weights[k:], axis=0)
    return np.divide(np.sum(weights, axis=0) ** 2, pairs, out=np.full(weights.shape[1], np.inf), where=pairs > 0)


def widening(degrees: np.ndarray) -> np.ndarray:
    """Factors (d,) of standard errors that rest on so many degrees of freedom: 1.96 of the product are the 95 %
    interval of Student's t."""
    return stdtrit(np.maximum(degrees, 1.0), 0.5 + LEVEL / 2) / ndtri(0.5 + LEVEL / 2)


def at_most(degrees: np.ndarray) -> np.ndarray:
    """Factors (d,) of estimated variances with so many degrees of freedom that the true ones exceed in one of ten
    samples."""
    degrees = np.maximum(degrees, 1.0)
    return degrees / chdtri(degrees, 1.0 - ABOVE)


def _in_order(scores: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Scores by sample number from the first on, those of one number summed, missing ones zero."""
    first = int(np.min(index))
    spread = np.zeros((int(np.max(index)) - first + 1, scores.shape[1]))
    np.add.at(spread, index - first, scores)
    return spread


def _prewhitened(spread: np.ndarray, fitted: int) -> tuple[np.ndarray, np.ndarray]:
    """The columns less what the sample before foretells of them, and how much that is (d,)."""
    memory = np.clip(unbiased(first_correlation(spread), len(spread), fitted), 0.0, most_memory(len(spread), fitted))
    return spread - memory * np.vstack([spread[:1], spread[:-1]]), memory


def unbiased(r: np.ndarray, n: int, fitted: int) -> np.ndarray:
    """First correlations (d,) of n residuals, corrected for the bias that a mean (Kendall, Biometrika 41 (1954) 403:
    (1 + 3 r) / n) and `fitted` slow regressors, each (1 + r) / n, give them; those that chance explains (below 2 /
    sqrt(n)) stay, all for `fitted` 0."""
    return np.where(
        (fitted > 0) & (r > 2.0 / np.sqrt(n)), r + (1.0 + 3.0 * r + min(fitted, REGRESSORS) * (1.0 + r)) / n, r
    )


def most_memory(n: int, fitted: int) -> float:
    """The largest correlation that n samples can tell from a drift; 0.97 where `fitted` is not known."""
    return max(0.6, 1.0 - 8.0 / n) if fitted else 0.97


def inflation(series: np.ndarray, index: np.ndarray, fitted: int = 0) -> float:
    """Factor, at least 1, by which correlation of a series (m,) at numbers `index` (m,) raises the variance of its
    mean; `fitted` as in `prewhitened_long_run`."""
    power = float(np.sum(series**2))
    return max(1.0, float(prewhitened_long_run(series[:, None], index, fitted)[0, 0]) / power) if power > 0 else 1.0


def first_correlation(series: np.ndarray) -> np.ndarray:
    """AR(1) coefficient (d,) of every column of (n, d); 0 for a column of zeros."""
    power = np.sum(series**2, axis=0)
    return np.divide(np.sum(series[1:] * series[:-1], axis=0), power, out=np.zeros_like(power), where=power > 0)


def bandwidth(series: np.ndarray) -> int:
    """Lags of the Bartlett kernel for columns (n, d) taken as AR(1): 1.1447 (a n)^(1/3), a = mean of 4 rho^2 / (1 -
    rho^2)^2.

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
