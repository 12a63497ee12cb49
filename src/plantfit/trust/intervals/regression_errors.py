"""Covariance of plain least squares with several targets and recordings, sound when errors are correlated in time
and between targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.problem.measure.long_run import degrees_of_freedom, prewhitened_long_run, widening


@dataclass(frozen=True)
class RegressionPart:
    """One target in one recording: columns (n, k), residuals (n,), sample numbers `index` (n,) by time, 0, 1, .. if
    None.

    `weight` multiplies the squared residuals of this target in the fit.
    """

    columns: Any
    residuals: Any
    index: Any = None
    record: str = ""
    weight: float = 1.0


def regression_covariance(parts: Sequence[RegressionPart]) -> np.ndarray:
    """Covariance (k, k) of the coefficients that minimise the weighted sum of squares over all parts.

    What each sample does to the estimate, (X'WX)^-1 x w r, is added up over the targets of a recording, whose errors
    may move together, and its prewhitened long-run covariance taken (see `covariance`); recordings are independent. It
    is widened to Student's t where a few samples decide a coefficient (`degrees_of_freedom`). Raises RecordingError for
    shapes that do not fit, and for columns that determine fewer than k numbers (see `base_parameters`).
    """
    read = [_read(p) for p in parts]
    columns = np.vstack([np.sqrt(p.weight) * c for p, (c, _, _) in zip(parts, read, strict=True)])
    n, k = columns.shape
    norms = np.linalg.norm(columns, axis=0)
    triangle = np.asarray(np.linalg.qr(columns / np.maximum(norms, 1e-300), mode="r"))
    if n < k or np.linalg.cond(triangle) > 1e12:
        raise RecordingError(
            f"The columns of the regression do not determine its {k} "
            "coefficients; regroup them with base_parameters first."
        )
    inverse = np.linalg.inv(triangle)
    bread = (inverse @ inverse.T) / np.outer(norms, norms)
    spread, totals, squares = np.zeros((k, k)), np.zeros(k), np.zeros(k)
    for record in dict.fromkeys(p.record for p in parts):
        own = [(p, c, r, at) for p, (c, r, at) in zip(parts, read, strict=True) if p.record == record]
        index = np.concatenate([at for *_, at in own])
        scores = np.concatenate([c * (p.weight * r)[:, None] @ bread for p, c, r, _ in own])
        spread += prewhitened_long_run(scores, index, k)
        shares = np.concatenate([(p.weight * (c @ bread)) ** 2 * np.mean(r**2) for p, c, r, _ in own])
        total = np.sum(shares, axis=0)
        totals, squares = totals + total, squares + total**2 / degrees_of_freedom(scores, shares, index)
    few = widening(np.divide(totals**2, squares, out=np.full(k, np.inf), where=squares > 0))
    return 0.5 * (spread + spread.T) * np.outer(few, few) * n / max(1, n - k)


def _read(p: RegressionPart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, residuals = np.asarray(p.columns, dtype=float), np.asarray(p.residuals, dtype=float)
    index = np.arange(len(residuals)) if p.index is None else np.asarray(p.index, dtype=int)
    where = f" of recording {p.record!r}" if p.record else ""
    if (
        columns.ndim != 2
        or len(residuals) == 0
        or residuals.shape != columns.shape[:1]
        or index.shape != residuals.shape
    ):
        shapes = f"{columns.shape}, {residuals.shape} and {index.shape}"
        raise RecordingError(
            f"Columns, residuals and sample numbers{where} have shapes {shapes}; give (n, k), (n,) and (n,)."
        )
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(residuals))):
        raise RecordingError(f"The regression{where} has a missing value; leave that row out and give sample numbers.")
    return columns, residuals, index
