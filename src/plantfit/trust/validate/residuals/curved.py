"""Whether residuals of a model at rest follow a curve in its inputs: its own curve is then another one.

Rows that were not recorded one after the other leave no pattern in their order, whatever the model lacks. A polynomial
of the inputs that explains more of the residuals than chance does (F test, as Ramsey, J. R. Stat. Soc. B 31 (1969) 350)
shows it.
"""

from collections.abc import Mapping

import numpy as np
import scipy  # scipy.special is loaded at its first use

from plantfit.findings.residuals import Curved

SURE = 1e-3  # p-value below which it is no chance
ROWS = 4.0  # for each term of the polynomial
ALONE, TOGETHER = 3, 2  # its order in one input, and in several
LEAST = 1e-9  # of the deviation that a signal has beside the others


def curved(residual: np.ndarray, inputs: Mapping[str, np.ndarray], fitted: int, tests: int = 1) -> Curved | None:
    """What a polynomial of the inputs (n,) explains of residuals (n,), NaN where missing, of a fit of so many
    parameters; None where that is no more than chance gives in one of so many `tests`.

    A residual has nothing left along what the parameters do, which makes the test the more careful.
    """
    there = np.isfinite(residual) & np.all([np.isfinite(v) for v in inputs.values()], axis=0)
    r = residual[there]
    moving = {n: v[there] for n, v in inputs.items() if np.ptp(v[there]) > LEAST * np.max(np.abs(v[there]))}
    terms = _terms(list(moving.values()), len(r), fitted)
    if terms is None or not np.any(r):
        return None
    q, s, _ = np.linalg.svd(terms, full_matrices=False)
    q = q[:, s > LEAST * s[0]]
    count, free = q.shape[1], len(r) - q.shape[1] - fitted
    told = float(np.sum((q.T @ r) ** 2))
    left = float(r @ r) - told
    if free < 1 or left <= 0:
        return None
    chance = float(scipy.special.fdtrc(count, free, told / count / (left / free)))
    if chance > SURE / max(tests, 1):
        return None
    return Curved(inputs=list(moving), explained=told / float(r @ r), p_value=chance, noise=float(np.sqrt(left / free)))


def _terms(signals: list[np.ndarray], rows: int, fitted: int) -> np.ndarray | None:
    """Columns (n, k) of a polynomial: of third order in one signal, of second in several, with their products where
    rows allow; None where these are too few."""
    if not signals:
        return None
    x = [(v - v.mean()) / v.std() for v in signals]
    order = ALONE if len(x) == 1 else TOGETHER
    own = [np.ones(rows), *(v**k for v in x for k in range(1, order + 1))]
    both = [a * b for i, a in enumerate(x) for b in x[:i]]
    for columns in ([*own, *both], own):
        if rows - fitted >= ROWS * len(columns):
            return np.column_stack(columns)
    return None
