"""Whether a signal looks like a reading that was rounded to whole steps, and not like a command that goes from level
to level."""

import numpy as np

from plantfit.recording.looks.signals import COARSE, LEVELS

FEW = 6  # levels below which nothing tells steps from levels that somebody chose
OFTEN = 3.0  # changes by levels: a staircase that goes up and down again has 2
NEAR = 3.0  # steps by which it changes, at the median: what jumps farther was told to
EVEN = 0.05  # of a step, rms, by which levels may be off a grid: a text of few digits rounds them once more
UNEVEN = 0.4  # of their mean, by which times between changes scatter
SAME = 1e-9  # of the range, by which one level may be two numbers
SURE = 12  # levels on a fine grid: so many are not on one by chance
HELD, JUMPS = 3, 1.5  # samples that a program holds a level at least, and steps from one to the next in the mean
TURNS = 0.4  # of its changes that go back; two of three levels by chance do
MOVES = 0.1  # of the samples that change where steps are fine: a command is held for long
RAMP = 0.95  # of the samples that move by as much: a ramp whose own increment is the grid
QUICK = 0.8  # the same where changes are of many steps: a reading that moves so far is seldom the same again


def rounded_step(values: np.ndarray) -> float | None:
    """The step of a signal (n,) that comes in levels of an even grid as a reading does; None for any other.

    On a coarse grid, of steps of more than 1 % of the range, it goes from level to neighbouring level, back and forth
    or at uneven times. Levels are few beside the samples there, as for the look "quantised". On a fine grid it moves
    most of the time, and is not held as a command is.
    """
    y = values[np.isfinite(values)]
    levels = np.unique(y)
    levels = levels[np.diff(levels, prepend=-np.inf) > SAME * float(levels[-1] - levels[0])] if len(levels) else levels
    step = even_grid(levels) if len(levels) >= FEW else None
    if step is None:
        return None
    moves = np.abs(np.diff(y)) / step
    moves = moves[moves > 0.5]
    far = len(moves) == 0 or float(np.median(moves)) > NEAR
    if step > COARSE * float(levels[-1] - levels[0]):
        often = len(moves) >= OFTEN * len(levels) or (len(levels) >= SURE and _stays_unevenly(y, step))
        return step if len(levels) <= LEVELS * len(y) and often and not far and not _by_program(y, moves) else None
    alike = float(np.max(np.unique(np.round(np.abs(np.diff(y)) / step), return_counts=True)[1])) if len(y) > 1 else 0.0
    if alike > RAMP * len(y):
        return None
    return step if len(levels) >= SURE and len(moves) >= (QUICK if far else MOVES) * len(y) else None


def _by_program(y: np.ndarray, moves: np.ndarray) -> bool:
    """Whether a signal (n,) changes at whole multiples of a few samples only, by `moves` (k,) of several steps among
    them, and turns round as often as levels by chance do: a program of levels. A reading that is fresh at every so
    many samples goes on as it went, or to a neighbouring level."""
    at = np.flatnonzero(np.abs(np.diff(y)) > 0)
    stays, ways = np.diff(at), np.sign(np.diff(y)[at])
    if len(stays) < FEW or int(np.gcd.reduce(stays)) < HELD:
        return False
    return float(np.mean(moves)) > JUMPS and float(np.mean(ways[1:] != ways[:-1])) > TURNS


def _stays_unevenly(y: np.ndarray, step: float) -> bool:
    """Whether some levels are held much longer than others, as by a smooth signal; a program of levels holds each as
    long."""
    stays = np.diff(np.flatnonzero(np.abs(np.diff(y)) > 0.5 * step))
    return len(stays) > 1 and float(np.std(stays)) > UNEVEN * float(np.mean(stays))


def even_grid(levels: np.ndarray) -> float | None:
    """The step of an even grid on which levels (m,), in rising order, lie; None where they lie on none."""
    apart = np.diff(levels)
    whole = np.concatenate([[0.0], np.cumsum(np.round(apart / float(np.min(apart))))])
    step = float(levels[-1] - levels[0]) / float(whole[-1])
    off = (levels - levels[0]) / step - whole
    return step if float(np.sqrt(np.mean(off**2))) < EVEN else None
