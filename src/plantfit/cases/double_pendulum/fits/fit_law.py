"""Bounded least squares of a friction law over several recordings, its torque error and its intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import lsq_linear

from plantfit.cases.double_pendulum.fits.laws import PLAIN, PRESLIDING, Fitted, Law, model_of
from plantfit.cases.double_pendulum.fits.runs import Run
from plantfit.trust.intervals.regression_errors import RegressionPart, regression_covariance

THINNED = 10  # every so many samples are fitted: 50 Hz for a bandwidth of 5 Hz
BOUNDS = {"offset": (-1.0, 1.0)}  # of a parameter by its kind; all others are positive
ZERO_BOUND = 0.2  # rad


def fit_law(law: Law, runs: Mapping[str, Run]) -> Fitted:
    """Bounded least squares over all runs; the shape is the one of the grid with the least cost on these runs.

    A load is what the same law without load, fitted first to the same runs, says the torque is.
    """
    first = None
    if "load" in law.parts:
        plain = PRESLIDING if law.sign == "presliding" else PLAIN
        first = fit_law(replace(plain, zeros=law.zeros), runs)
    shapes = (first.shape,) if first is not None and law.sign == "presliding" else law.grid
    made = [_solved(law, shape, first, runs) for shape in shapes]
    if law.zeros:
        made = [_with_zeros(f, runs) for f in made]
    return min(made, key=lambda f: f.cost)


def _solved(law: Law, shape: float, first: Fitted | None, runs: Mapping[str, Run]) -> Fitted:
    blocks = [run.block(law, shape, first) for run in runs.values()]
    A, y = (np.concatenate([_rows(b[k]) for b in blocks]) for k in (0, 1))
    names = list(model_of(law, shape).coefficients)
    x = _bounded(A, y, *_bounds(names))
    return Fitted(law, shape, dict(zip(names, x.tolist(), strict=True)), float(np.mean((A @ x - y) ** 2)), first)


def _with_zeros(start: Fitted, runs: Mapping[str, Run]) -> Fitted:
    """Gauss-Newton in the parameters and the encoder zeros of every run: A x + d1 D1 x + d2 D2 x, small angles."""
    law, shape, first = start.law, start.shape, start.first
    blocks = [run.block(law, shape, first) for run in runs.values()]
    A, y = [_rows(a) for a, _ in blocks], np.concatenate([_rows(t) for _, t in blocks])
    D: list[list[np.ndarray]] = [[_rows(d) for d in run.slopes(law, shape, first)] for run in runs.values()]
    names = list(start.values)
    x, zeros = np.array(list(start.values.values())), np.zeros((len(runs), 2))
    low, high = _bounds(names)
    edge = np.full(zeros.size, ZERO_BOUND)
    for _ in range(6):
        moved = _moved(A, D, zeros)
        own = np.asarray(block_diag(*[np.stack([d[0] @ x, d[1] @ x], axis=1) for d in D]), dtype=float)
        joint = np.concatenate([moved, own], axis=1)
        found = _bounded(joint, y + own @ zeros.ravel(), np.concatenate([low, -edge]), np.concatenate([high, edge]))
        x, zeros = found[: len(names)], found[len(names) :].reshape(-1, 2)
    moved = _moved(A, D, zeros)
    cost = float(np.mean((moved @ x - y) ** 2))
    return Fitted(
        law, shape, dict(zip(names, x.tolist(), strict=True)), cost, first, dict(zip(runs, zeros, strict=True))
    )


def _moved(A: Sequence[np.ndarray], D: Sequence[Sequence[np.ndarray]], zeros: np.ndarray) -> np.ndarray:
    """The columns of all runs below each other, each run at its zeros (runs, 2)."""
    return np.concatenate(
        [np.asarray(a + z[0] * d[0] + z[1] * d[1], dtype=float) for a, d, z in zip(A, D, zeros, strict=True)]
    )


def _rows(values: np.ndarray) -> np.ndarray:
    """Both joints of (2, n, ...) below each other, thinned."""
    thin = values[:, ::THINNED]
    return thin.reshape(-1, *thin.shape[2:])


def _bounds(names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.array([BOUNDS.get(n.rstrip("12"), (0.0, np.inf)) for n in names]).T
    return low, high


def _bounded(A: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(A, axis=0)
    return lsq_linear(A / norm, y, (low * norm, high * norm), method="bvls").x / norm


def predicted(fitted: Fitted, run: Run) -> np.ndarray:
    """Torque of both joints (2, n), filtered alike, at the scored samples."""
    return run.block(fitted.law, fitted.shape, fitted.first)[0] @ np.array(list(fitted.values.values()))


def torque_scores(fitted: Fitted, run: Run) -> dict[str, float]:
    """RMSE (N m) of joint 1, joint 2 and both."""
    return rmse_of(predicted(fitted, run) - run.block(fitted.law, fitted.shape, fitted.first)[1])


def rmse_of(error: np.ndarray) -> dict[str, float]:
    """RMSE of joint 1, joint 2 and both, of errors (2, n)."""
    squares = np.mean(error**2, axis=1)
    return {
        "joint 1": float(squares[0] ** 0.5),
        "joint 2": float(squares[1] ** 0.5),
        "both": float(np.mean(squares) ** 0.5),
    }


def standard_errors(fitted: Fitted, runs: Mapping[str, Run]) -> dict[str, float]:
    """Of the parameters inside their bounds; the shape and the loads taken as known, encoder zeros fitted along.

    Sound for residuals that are correlated in time and between the joints of a run (`regression_covariance`).
    """
    names = list(fitted.values)
    x = np.array(list(fitted.values.values()))
    low, high = _bounds(names)
    inside = (x > low) & (x < high)
    parts = []
    for k, (name, run) in enumerate(runs.items()):
        A, y = run.block(fitted.law, fitted.shape, fitted.first)
        own = np.zeros((*y.shape, 2 * len(runs) if fitted.zeros else 0))
        if fitted.zeros:
            slopes = run.slopes(fitted.law, fitted.shape, fitted.first)
            A = A + sum(z * d for z, d in zip(fitted.zeros[name], slopes, strict=True))
            own[..., 2 * k : 2 * k + 2] = np.stack([d @ x for d in slopes], axis=-1)
        joint = np.concatenate([A[..., inside], own], axis=-1)
        parts += [RegressionPart(joint[j, ::THINNED], (A @ x - y)[j, ::THINNED], record=name) for j in (0, 1)]
    spread = np.sqrt(np.diag(regression_covariance(parts)))
    return dict(zip([n for n, free in zip(names, inside, strict=True) if free], spread.tolist(), strict=False))
