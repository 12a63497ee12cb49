"""How much wider an interval has to be where few recordings agree: agreement of few is often chance.

The variance of the answer about the mean of the plant is v = 1 + r^2 times that by the noise, r the scatter between
recordings in units of what noise does to the answer. What the recordings show of v is h, with `degrees` of freedom, as
a mean square shows a variance. The interval is the posterior one with r = 0 weighing as much as `NONE` of a density
1/(1 + r) over all r: even below the noise, even in the logarithm above it (a prior in units of the noise, as the 1/(1 +
r)^2 of DuMouchel, in Berry (ed.), Statistical Methodology in the Pharmaceutical Sciences, 1990, 509). Its tail is that
of Hartung and Knapp's interval, so that it holds at any scatter.
"""

import numpy as np
from scipy.special import ndtr

from plantfit.problem.measure.long_run import NORMAL

NONE = 5.0  # weight of no scatter: as much as of all scatter up to e^5 - 1 = 150 times the noise
GRID = np.r_[0.0, np.geomspace(1e-2, 1e5, 400)]  # of r
HALVINGS = 60


def times_wider(h: float, degrees: float) -> float:
    """By which an interval of 95 % by the noise has to grow, at least 1.

    `h` is the variance of the answer that recordings show over that by the noise, with so many `degrees` of freedom.
    """
    step = np.log(GRID[2] / GRID[1])
    prior = np.r_[NONE, GRID[1:] * step / (1.0 + GRID[1:])]
    v = 1.0 + GRID**2
    told = -0.5 * degrees * (np.log(v) + h / v)
    weights = prior * np.exp(told - np.max(told))
    weights /= weights.sum()
    low, high = 1.0, max(1.0, 1e3 * h**0.5)
    for _ in range(HALVINGS):
        middle = (low * high) ** 0.5
        held = float(weights @ (2.0 * ndtr(NORMAL * middle / np.sqrt(v)) - 1.0))
        low, high = (middle, high) if held < 0.95 else (low, middle)
    return high


__all__ = ["times_wider"]
