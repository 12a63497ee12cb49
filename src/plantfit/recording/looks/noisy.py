"""Whether a signal that goes from level to level shakes on them as a reading does, and by how much."""

import numpy as np

NORMAL_MAD = 1.4826  # standard deviations of normal noise for each median absolute deviation
JUMP = 6.0  # standard deviations of a difference, from which on the signal goes to another level
FEWEST, JUMPS = 5, 3  # samples of a level, and jumps, that are needed
MOST = 0.05  # of the range: what shakes by more may have been told to
COVERED = 0.5  # of the samples that lie on such levels
ODD = 4.0  # times the median variance of levels, from which on one is left out
WHITE = (0.7, 1.4)  # variance on a level over half the mean square of its differences: 1 of white noise


def reading_noise(values: np.ndarray) -> float | None:
    """The standard deviation of white noise on a signal (n,) that stays at levels and jumps between them; None for any
    other.

    Of a signal that moves all the time, as in a sine, nothing tells its noise from its motion, and of one that never
    jumps nothing says that it was held. The test is von Neumann's ratio (Ann. Math. Statist. 12 (1941) 367) on each
    level, of which the median counts.
    """
    y = values[np.isfinite(values)]
    apart = np.abs(np.diff(y))
    if len(y) < JUMPS * FEWEST or np.mean(apart > 0) < COVERED:
        return None
    size = NORMAL_MAD * float(np.median(apart)) / np.sqrt(2.0)
    ends = _jumps(y, size)
    levels = [v for v in np.split(y, ends) if len(v) >= FEWEST]
    if size <= 0 or size > MOST * float(np.ptp(y)) or len(ends) < JUMPS or sum(map(len, levels)) < COVERED * len(y):
        return None
    squares = np.array([[np.var(v, ddof=1), 0.5 * np.mean(np.diff(v) ** 2)] for v in levels])
    about, beside = np.median(squares, axis=0)
    if not WHITE[0] * beside < about < WHITE[1] * beside:
        return None
    even = squares[:, 0] < ODD * about  # not those in which a smaller jump is hidden
    weights = np.array([len(v) - 1.0 for v in levels])
    return float(np.sqrt(np.average(squares[even, 0], weights=weights[even])))


def longest_level(values: np.ndarray, size: float) -> tuple[int, int]:
    """Places from and to which a signal (n,) with noise of a standard deviation `size` stays at one level longest."""
    ends = np.r_[0, _jumps(values, size), len(values)]
    longest = int(np.argmax(np.diff(ends)))
    return int(ends[longest]), int(ends[longest + 1])


def _jumps(values: np.ndarray, size: float) -> np.ndarray:
    """Places of the samples with which another level begins."""
    return np.flatnonzero(np.abs(np.diff(values)) > JUMP * np.sqrt(2.0) * size) + 1
