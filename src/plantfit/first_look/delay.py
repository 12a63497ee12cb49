"""When an output begins to react to an input: cross-correlation after both were filtered so that the input is white."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from plantfit.first_look.data import Data

ORDER = 12  # of the whitening filter at most
SHARE = 0.1  # of the record, how late a reaction is looked for
CHANCE = 0.01  # that any lag before the reaction is beyond the band in one of two looks


@dataclass(frozen=True)
class Delay:
    """`value` (s): one sample before the first lag beyond the band, since an input that is held acts from one sample
    on; None where no lag is. `lags` (k,) s, `correlation` (k,), and the `bound` of all lags together. `both`: the
    output was made white, too."""

    value: float | None
    lags: np.ndarray
    correlation: np.ndarray
    bound: float
    both: bool = False


def reaction_delay(data: Data, k: int) -> Delay:
    """The delay from input k to the output.

    An autoregression whitens the input, the output passes the same filter, and their correlation is the impulse
    response in noise (Box, Jenkins and Reinsel, Time Series Analysis, 4th ed. 2008, section 12.2.1). Missing outputs
    are left out. Then the output is whitened by an autoregression of its own (Haugh 1976, J. Am. Stat. Assoc. 71:378):
    a causal filter leaves the first lag where it is, and of an output that integrates it takes what hides it. The
    earlier of both counts.
    """
    u, y = data.inputs[:, k], data.y
    known = np.isfinite(y)
    y = np.interp(np.arange(len(y)), np.flatnonzero(known), y[known])
    du, dy = u - u.mean(), y - y.mean()
    n = len(du)
    most = max(5, int(SHARE * n))
    lags = data.period * np.arange(most)
    if not np.any(du):
        return Delay(None, lags, np.zeros(most), np.nan)
    order = min(ORDER, n // 20)
    bound = float(-special.ndtri(0.25 * CHANCE / most) / np.sqrt(n))  # two sides, two looks
    own = _whitening(du, order)
    a = _filtered(du, own)
    first, second = (_correlation(a, _filtered(dy, w), most) for w in (own, _whitening(dy, order)))
    value, other = (_reaction(c, bound, data.period) for c in (first, second))
    if other is None or (value is not None and value <= other):
        return Delay(value, lags, first, bound)
    return Delay(other, lags, second, bound, both=True)


def _reaction(correlation: np.ndarray, bound: float, period: float) -> float | None:
    # lag 0 is no part of a held input's answer, but of sensors that are read later than the input
    beyond = np.flatnonzero(np.abs(correlation) > bound)
    return None if not len(beyond) else period * max(0, int(beyond[0]) - 1)


def _whitening(x: np.ndarray, order: int) -> np.ndarray:
    """The prediction error filter (order + 1,) of an autoregression of x (n,)."""
    n = len(x)
    lagged = np.column_stack([np.r_[np.zeros(j), x[:-j]] for j in range(1, order + 1)]) if order else np.zeros((n, 0))
    return np.r_[1.0, -np.linalg.lstsq(lagged, x, rcond=1e-10)[0]]


def _filtered(x: np.ndarray, white: np.ndarray) -> np.ndarray:
    out = np.convolve(x, white)[: len(x)]
    out[: len(white) - 1] = 0.0  # what came before the record is not known
    return out


def _correlation(a: np.ndarray, b: np.ndarray, most: int) -> np.ndarray:
    """Of b with a earlier, at lags 0 to most - 1."""
    size = 1 << int(np.ceil(np.log2(2 * len(a))))
    both = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)[:most]
    size = np.sqrt(np.sum(a**2) * np.sum(b**2))
    return both / size if size > 0 else np.zeros(most)
