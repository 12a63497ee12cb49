"""Errors that are correlated in time and between outputs, made white by an autoregression."""

from typing import NamedTuple

import numpy as np


class Whitening(NamedTuple):
    """Rows a_t (m, ...) become scale (a_t - sum_i filters[i] a_(t-1-i)); the first p rows of every stretch are lost."""

    filters: np.ndarray  # (p, m, m)
    scale: np.ndarray  # (m, m)

    @property
    def order(self) -> int:
        return len(self.filters)

    def __call__(self, rows: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """The rows numbered `kept`, whitened; rows (n, m) or (n, m, k)."""
        now = np.array(rows[kept], dtype=float)
        for i, a in enumerate(self.filters):
            now -= np.einsum("ab,nb...->na...", a, rows[kept - 1 - i])
        return np.einsum("ab,nb...->na...", self.scale, now)


def usable(index: np.ndarray, order: int) -> np.ndarray:
    """Numbers of the rows whose `order` predecessors are the samples just before them."""
    rows = np.arange(len(index))
    if order == 0:
        return rows
    late = rows[order:]
    return late[index[late] - index[late - order] == order]


def whitening(residuals: np.ndarray, index: np.ndarray, largest: int) -> Whitening:
    """Vector autoregression of residuals (n, m), its order from 0 to `largest` that with the least BIC.

    Least squares equation by equation: Luetkepohl, New Introduction to Multiple Time Series Analysis (2005), sections
    3.2 and 4.3, all orders on the same rows. `scale` makes the innovations uncorrelated with unit variance.
    """
    m, kept = residuals.shape[1], usable(index, largest)
    now, past = residuals[kept], [residuals[kept - 1 - i] for i in range(largest)]
    best: tuple[float, Whitening] | None = None
    for p in range(largest + 1):
        before = np.concatenate([*past[:p], np.zeros((len(kept), 0))], axis=1)
        slopes = np.linalg.lstsq(before, now, rcond=None)[0]
        innovations = now - before @ slopes
        covariance = innovations.T @ innovations / max(len(kept) - p * m, 1)
        criterion = np.linalg.slogdet(covariance)[1] + p * m * m * np.log(len(kept)) / len(kept)
        if best is None or criterion < best[0]:
            filters = slopes.reshape(p, m, m).transpose(0, 2, 1)
            best = criterion, Whitening(filters, np.linalg.inv(np.linalg.cholesky(covariance)))
    assert best is not None
    return best[1]
