"""Whether the residuals of a model at rest are of several sizes along what it tells.

Errors that grow with what is measured, as of an instrument of so many per cent, count too much where they are large,
and standard errors that take all of them as of one size are too small. Squares of residuals are regressed on a parabola
of the simulated output (Breusch and Pagan, Econometrica 47 (1979) 1287, with the squares' own variance, Koenker, J.
Econometrics 17 (1981) 107), which supposes no normal distribution.
"""

import numpy as np
import scipy  # scipy.special is loaded at its first use

from plantfit.findings.residuals import Sizes

SURE = 1e-3  # p-value below which it is no chance
ROWS = 30  # fewer tell no sizes
TIMES = 2.0  # the larger size over the smaller one, from which on it matters
THIRD = 3  # of the rows, in which sizes are told


def sizes(residual: np.ndarray, simulated: np.ndarray, tests: int = 1) -> Sizes | None:
    """The sizes of residuals (n,) where the output is simulated (n,) small and large; None where they differ by no more
    than chance makes them in one of so many `tests`, or too little to matter."""
    there = np.isfinite(residual) & np.isfinite(simulated)
    square, z = residual[there] ** 2, simulated[there]
    if len(z) < ROWS or np.ptp(z) <= 1e-9 * np.max(np.abs(z)) or np.ptp(square) == 0.0:
        return None
    x = (z - z.mean()) / z.std()
    columns = np.column_stack([np.ones(len(x)), x, x**2])
    fit, *_ = np.linalg.lstsq(columns, square, rcond=None)
    left = float(np.sum((square - columns @ fit) ** 2))
    told, free = float(np.sum((square - square.mean()) ** 2)) - left, len(x) - columns.shape[1]
    chance = float(scipy.special.fdtrc(2, free, max(told, 0.0) / 2 / (left / free))) if left > 0.0 else 0.0
    order, count = np.argsort(z, kind="stable"), len(z) // THIRD
    low, high = (float(np.sqrt(np.mean(square[part]))) for part in (order[:count], order[-count:]))
    if chance > SURE / max(tests, 1) or max(low, high) < TIMES * min(low, high):
        return None
    return Sizes(low=low, high=high, p_value=chance)
