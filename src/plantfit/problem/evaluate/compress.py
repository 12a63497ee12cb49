"""A linear regression of many samples as a triangle of a few rows, with the same mean square."""

from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError
from plantfit.problem.evaluate.triangle import triangle

import jax.numpy as jnp

BLOCK = 65_536  # samples that are factored at once


class Compressed(NamedTuple):
    """|target - regressor b|^2 = |R b - projected|^2 + rest for every b (k,); `n` samples. R is (k, k), projected
    (k,)."""

    R: Any
    projected: Any
    rest: Any
    n: Any


def compress(regressor: Any, target: Any) -> Compressed:
    """Factor a regressor (N, k) and a target (N,) once, for any N and any rank.

    R and the projected target are the triangle of the QR factorisation of [regressor, target] by
    Householder reflections, block of rows by block of rows, which keeps norms to rounding whatever the rank
    (Golub, Van Loan, Matrix Computations, 4th ed., sections 5.3 and 6.5).
    Raises RecordingError for shapes that do not fit, no samples, or a value that is missing.
    """
    columns, y = np.asarray(regressor, dtype=float), np.asarray(target, dtype=float)
    if columns.ndim != 2 or y.shape != columns.shape[:1] or columns.shape[1] == 0:
        raise RecordingError(f"The regressor has shape {columns.shape} and the target {y.shape}; give (N, k) and (N,).")
    if len(y) == 0:
        raise RecordingError("The regression has no samples; check the interval that is fitted.")
    bad = np.flatnonzero(~(np.isfinite(y) & np.all(np.isfinite(columns), axis=1)))
    if len(bad):
        raise RecordingError(f"The regression has a missing value at sample {bad[0]}; leave that row out.")
    k = columns.shape[1]
    small = np.zeros((0, k + 1))
    for first in range(0, len(y), BLOCK):
        rows = slice(first, first + BLOCK)
        small = triangle(np.vstack([small, np.column_stack([columns[rows], y[rows]])]))
    full = np.zeros((k + 1, k + 1))
    full[: len(small)] = small
    return Compressed(full[:k, :k], full[:k, k], float(full[k, k] ** 2), len(y))


def mean_square(compressed: Compressed, base: Any) -> Any:
    """Mean of the squared residuals at coefficients base (..., k), of shape (...,); jax-traceable."""
    base = jnp.asarray(base)
    total = jnp.asarray(compressed.rest)
    # written out row by row, a batch becomes one fused loop over the candidates
    for i in range(len(compressed.projected)):
        row = sum(compressed.R[i, j] * base[..., j] for j in range(i, len(compressed.projected)))
        total = total + (row - compressed.projected[i]) ** 2
    return total / compressed.n
