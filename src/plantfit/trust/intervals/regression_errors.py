"""Covariance of plain least squares with several targets and recordings, sound when errors are correlated in time and between targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.problem.measure.long_run import prewhitened_long_run


@dataclass(frozen=True)
class RegressionPart:
    """One target in one recording: columns (n, k), residuals (n,), sample numbers `index` (n,) by time, 0, 1, .. if None.

    `weight` multiplies the squared residuals of this target in the fit.
    """

    columns: Any
    residuals: Any
    index: Any = None
    record: str = ""
    weight: float = 1.0


def regression_covariance(parts: Sequence[RegressionPart]) -> np.ndarray:
    """Covariance (k, k) of the coefficients that minimise the weighted sum of squares over all parts.

    What each sample does to the estimate, (X'WX)^-1 x w r, is added up over the targets of a recording, whose errors may move
    together, and its prewhitened long-run covariance taken (see `covariance`); recordings are independent.
    Raises RecordingError for shapes that do not fit, and for columns that determine fewer than k numbers (see `base_parameters`).
    """
    read = [_read(p) for p in parts]
    columns = np.vstack([np.sqrt(p.weight) * c for p, (c, _, _) in zip(parts, read, strict=True)])
    n, k = columns.shape
    norms = np.linalg.norm(columns, axis=0)
    triangle = np.asarray(np.linalg.qr(columns / np.maximum(norms, 1e-300), mode="r"))
    if n < k or np.linalg.cond(triangle) > 1e12:
        raise RecordingError(
            f"The columns of the regression do not determine its {k} coefficients; regroup them with base_parameters first."
        )
    inverse = np.linalg.inv(triangle)
    bread = (inverse @ inverse.T) / np.outer(norms, norms)
    spread = np.zeros((k, k))
    for record in dict.fromkeys(p.record for p in parts):
        chosen = [(c * (p.weight * r)[:, None] @ bread, at) for p, (c, r, at) in zip(parts, read, strict=True) if p.record == record]
        first, last = min(at.min() for _, at in chosen), max(at.max() for _, at in chosen)
        series = np.zeros((int(last - first) + 1, k))
        for influence, at in chosen:
            np.add.at(series, at - first, influence)
        spread += prewhitened_long_run(series, np.arange(len(series)), k)
    return 0.5 * (spread + spread.T) * n / max(1, n - k)


def _read(p: RegressionPart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, residuals = np.asarray(p.columns, dtype=float), np.asarray(p.residuals, dtype=float)
    index = np.arange(len(residuals)) if p.index is None else np.asarray(p.index, dtype=int)
    where = f" of recording {p.record!r}" if p.record else ""
    if columns.ndim != 2 or len(residuals) == 0 or residuals.shape != columns.shape[:1] or index.shape != residuals.shape:
        shapes = f"{columns.shape}, {residuals.shape} and {index.shape}"
        raise RecordingError(f"Columns, residuals and sample numbers{where} have shapes {shapes}; give (n, k), (n,) and (n,).")
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(residuals))):
        raise RecordingError(f"The regression{where} has a missing value; leave that row out and give sample numbers.")
    return columns, residuals, index
