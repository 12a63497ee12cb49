"""Whether a signal looks like a reading that was rounded to whole steps, and not like a command that goes from level to level."""

import numpy as np

from plantfit.recording.looks.signals import COARSE, LEVELS

FEW = 6  # levels below which nothing tells steps from levels that somebody chose
OFTEN = 3.0  # changes by levels: a staircase that goes up and down again has 2
NEAR = 3.0  # steps by which it changes, at the median: what jumps farther was told to
EVEN = 1e-3  # of a step, by which levels may be off a grid


def rounded_step(values: np.ndarray) -> float | None:
    """The step of a signal (n,) that wanders from level to neighbouring level of an even grid, back and forth; None for any other.

    The grid is coarse: a step is more than 1 % of the range, and levels are few beside the samples, as for the look "quantised".
    """
    y = values[np.isfinite(values)]
    levels = np.unique(y)
    if not FEW <= len(levels) <= LEVELS * len(y):
        return None
    step = float(np.min(np.diff(levels)))
    whole = (levels - levels[0]) / step
    moves = np.abs(np.diff(y)) / step
    moves = moves[moves > 0.5]
    coarse = step > COARSE * float(levels[-1] - levels[0])
    even = float(np.max(np.abs(whole - np.round(whole)))) < EVEN * len(levels)
    return step if coarse and even and len(moves) >= OFTEN * len(levels) and float(np.median(moves)) <= NEAR else None
