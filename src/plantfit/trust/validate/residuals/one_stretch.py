"""A residual that lies in one short stretch of a record where inputs and simulation do what they do elsewhere: the
record is odd there."""

from collections.abc import Sequence

import numpy as np

from plantfit.findings.residuals import Stretch

FEWEST = 150  # samples
SHORT, SHARE = 0.1, 0.75  # of the samples at most, and of the squares at least
WIDTHS = 12  # of the stretches that are looked at
MOVES = 1.0 / 3.0  # of all that an input moves, in the stretch and before it at most
GAP = 1.5  # median periods, from which on a step of the clock is a gap


def one_stretch(
    t: np.ndarray, residual: np.ndarray, simulated: np.ndarray, inputs: Sequence[np.ndarray]
) -> Stretch | None:
    """The shortest stretch that holds most of the squares of a residual (n,) at the times t (n,), all finite; None
    where no short one does, and where a model that lacks something would leave the same.

    That is so at both ends of a record (initial values, what grows), and where the stretch or as many samples before it
    hold a good part of what an input moves in all, or levels of an input or of the simulated output that hardly are
    elsewhere (but after a gap of the clock).
    """
    n, squares = len(residual), np.concatenate([[0.0], np.cumsum(residual**2)])
    if n < FEWEST or not squares[-1] > 0.0:
        return None
    for width in np.unique(np.geomspace(max(3, 0.01 * n), SHORT * n, WIDTHS).astype(int)).tolist():
        held = squares[width:] - squares[:-width]
        begin = int(np.argmax(held))
        if held[begin] >= SHARE * squares[-1]:
            break
    else:
        return None
    end, before = begin + width, max(0, begin - width)
    if begin < width or end > n - width or not all(_moves_elsewhere(u, before, end) for u in inputs):
        return None
    steps = np.diff(t)
    longest = float(np.max(steps[before : begin + max(2, width // 4)]))
    gap = longest if longest > GAP * float(np.median(steps)) else None
    if gap is None and not all(_as_elsewhere(x, begin, end) for x in (simulated, *inputs)):
        return None
    return Stretch(
        begin=float(t[begin]), end=float(t[end - 1]), share=float(held[begin] / squares[-1]), samples=width / n, gap=gap
    )


def _as_elsewhere(x: np.ndarray, begin: int, end: int) -> bool:
    """Whether a signal is for as long elsewhere at or beyond both its ends here: what grows with its level would not
    lie here alone."""
    other = np.concatenate([x[:begin], x[end:]])
    long = end - begin
    return bool(np.sum(other >= np.max(x[begin:end])) >= long and np.sum(other <= np.min(x[begin:end])) >= long)


def _moves_elsewhere(u: np.ndarray, begin: int, end: int) -> bool:
    moved = np.diff(u) ** 2
    return bool(np.sum(moved[begin:end]) <= MOVES * np.sum(moved))
