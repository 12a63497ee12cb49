"""When an output begins to react to an input: cross-correlation after both were filtered so that the input is white."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from plantfit.first_look.data import Data

ORDER = 12  # of the whitening filter at most
SHARE = 0.1  # of the record, how late a reaction is looked for
CHANCE = 0.01  # that any lag before the reaction is beyond the band


@dataclass(frozen=True)
class Delay:
    """`value` (s): one sample before the first lag beyond the band, since an input that is held acts from one sample
    on; None where no lag is. `lags` (k,) s, `correlation` (k,), and the `bound` of all lags together."""

    value: float | None
    lags: np.ndarray
    correlation: np.ndarray
    bound: float


def reaction_delay(data: Data, k: int) -> Delay:
    """The delay from input k to the output.

    An autoregression whitens the input, the output passes the same filter, and their correlation is the impulse
    response in noise (Box, Jenkins and Reinsel, Time Series Analysis, 4th ed. 2008, section 12.2.1). Missing outputs
    are left out.
    """
    u, y = data.inputs[:, k], data.y
    known = np.isfinite(y)
    y = np.interp(np.arange(len(y)), np.flatnonzero(known), y[known])
    du, dy = u - u.mean(), y - y.mean()
    n = len(du)
    most = max(5, int(SHARE * n))
    if not np.any(du):
        return Delay(None, data.period * np.arange(most), np.zeros(most), np.nan)
    order = min(ORDER, n // 20)
    lagged = np.column_stack([np.r_[np.zeros(j), du[:-j]] for j in range(1, order + 1)]) if order else np.zeros((n, 0))
    coefficients = np.linalg.lstsq(lagged, du, rcond=1e-10)[0]
    white = np.r_[1.0, -coefficients]
    a, b = np.convolve(du, white)[:n], np.convolve(dy, white)[:n]
    a[:order], b[:order] = 0.0, 0.0  # what came before the record is not known
    size = 1 << int(np.ceil(np.log2(2 * n)))
    both = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)[:most]
    correlation = both / np.sqrt(np.sum(a**2) * np.sum(b**2))
    bound = float(-special.ndtri(0.5 * CHANCE / most) / np.sqrt(n))
    # lag 0 is no part of a held input's answer, but of sensors that are read later than the input
    beyond = np.flatnonzero(np.abs(correlation) > bound)
    value = None if not len(beyond) else data.period * max(0, int(beyond[0]) - 1)
    return Delay(value, data.period * np.arange(most), correlation, bound)
