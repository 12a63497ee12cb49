"""A part of a record in which an output moves against the simulation: a sign is wrong there."""

from itertools import combinations

import numpy as np

from plantfit.findings.residuals import Turned

FEWEST = 150  # samples
BLOCKS = 20  # of the record, at whose ends a part is looked for first
AGAINST = 0.8  # correlation in the part, negative, and elsewhere, at least
MOVES = 4  # times that the simulation passes its mean in the part, and elsewhere, at least
SHORT = 0.1  # of the record: no part is shorter


def turned(t: np.ndarray, measured: np.ndarray, simulated: np.ndarray) -> Turned | None:
    """The part of a record at the times t (n,) in which measured samples (n,) move against simulated ones and elsewhere with them.

    One stretch, by the correlation in it and in all the rest; None where that is not plain in both, or the simulation moves up and down too
    seldom for chance to be excluded.
    """
    n = len(t)
    if n < FEWEST:
        return None
    y, x = measured - np.mean(measured), simulated - np.mean(simulated)
    sums = np.concatenate([np.zeros((1, 5)), np.cumsum(np.stack([y, x, y * y, x * x, y * x], axis=1), axis=0)])

    def plain(begin: int, end: int) -> float:
        """The smaller of the two correlations."""
        inside = sums[end] - sums[begin]
        if end - begin < SHORT * n or n - (end - begin) < SHORT * n:
            return -1.0
        return min(-_correlation(inside, end - begin), _correlation(sums[n] - inside, n - (end - begin)))

    edges = np.linspace(0, n, BLOCKS + 1).astype(int).tolist()
    begin, end = max(combinations(edges, 2), key=lambda ends: plain(*ends))
    step, wide = max(1, n // 400), n // BLOCKS
    if begin > 0:
        begin = max(range(max(0, begin - wide), min(end, begin + wide + 1), step), key=lambda b: plain(b, end))
    if end < n:
        end = max(range(max(begin + 1, end - wide), min(n, end + wide + 1), step), key=lambda e: plain(begin, e))
    parts = x[begin:end], np.concatenate([x[:begin], x[end:]])
    if plain(begin, end) < AGAINST or min(map(_passes, parts)) < MOVES:
        return None
    inside = sums[end] - sums[begin]
    return Turned(
        begin=float(t[begin]), end=float(t[end - 1]), within=_correlation(inside, end - begin),
        elsewhere=_correlation(sums[n] - inside, n - (end - begin)),
    )  # fmt: skip


def _passes(x: np.ndarray) -> int:
    """How often a signal passes zero."""
    return int(np.sum(np.diff(np.signbit(x).astype(int)) != 0))


def _correlation(sums: np.ndarray, count: int) -> float:
    """From the sums of y, x, y^2, x^2 and xy of so many samples."""
    y, x, yy, xx, yx = sums / count
    size = max(yy - y * y, 0.0) * max(xx - x * x, 0.0)
    return float((yx - y * x) / np.sqrt(size)) if size > 1e-24 * max(yy * xx, 1e-300) else 0.0
