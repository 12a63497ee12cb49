"""A part of a record, or one of several records, in which an output moves against the simulation: a sign is wrong
there."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from plantfit.findings.residuals import Turned

FEWEST = 150  # samples
BLOCKS = 20  # of the record, at whose ends a part is looked for first
AGAINST = 0.8  # correlation in the part, negative, and elsewhere, at least
WITH = 0.5  # correlation in the other records, where a whole one moves against the simulation, at least
TESTED = 30  # samples of such a record
TURNS = 2  # times that the simulation passes its mean in it, at least
MOVES = 4  # times that the simulation passes its mean in the part, and elsewhere, at least
STIRS = 0.2  # of its spread elsewhere: a simulation that moves less in the part tells no sign
BESIDE = 0.5  # of the samples in the part, at levels that the simulation has elsewhere, too
ROUNDS = 3  # of fitting the rest and placing the part anew
# of the variance in the part, which the mirrored rest may miss where the simulation passes its mean less often
MISSED = 0.25
SHORT = 0.1  # of the record: no part is shorter


def turned(t: np.ndarray, measured: np.ndarray, simulated: np.ndarray) -> Turned | None:
    """The part of a record at the times t (n,) in which measured samples (n,) move against simulated ones and elsewhere
    with them.

    One stretch, by the correlation in it and in all the rest; None where that is not plain in both, or the simulation
    moves up and down too seldom for chance to be excluded.
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
    part = np.zeros(n, dtype=bool)
    part[begin:end] = True
    if plain(begin, end) < AGAINST:
        return None
    if min(_passes(x[part]), _passes(x[~part])) < MOVES:
        if (placed := _mirrored(measured, simulated, part)) is None or plain(*placed) < AGAINST:
            return None
        begin, end = placed
    inside = sums[end] - sums[begin]
    return Turned(
        begin=float(t[begin]), end=float(t[end - 1]), within=_correlation(inside, end - begin),
        elsewhere=_correlation(sums[n] - inside, n - (end - begin)),
    )  # fmt: skip


def turned_records(records: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, Turned]:
    """Of several records by name, each the times, the measured and the simulated samples (n,) of one output, those
    that move against the simulation from begin to end, where the others move with it.

    A cable was turned round before one of them: the fit of all then follows none, but keeps the sign of most. None is
    told where half of the records or more would be, but of two the one; nor where the simulation does not move up and
    down.
    """
    with_it: dict[str, float] = {}
    for name, (_, y, x) in records.items():
        if len(x) >= TESTED:
            with_it[name] = _correlation(np.array([y.sum(), x.sum(), y @ y, x @ x, y @ x]), len(x))
    against = [
        n for n, c in with_it.items() if c <= -AGAINST and _passes(records[n][2] - records[n][2].mean()) >= TURNS
    ]
    others = [c for name, c in with_it.items() if name not in against]
    most = len(against) == len(others) == 1 or len(against) < len(others)
    if not against or not most or max(others) < AGAINST or min(others) < WITH or len(with_it) < len(records):
        return {}
    return {
        name: Turned(
            begin=float(records[name][0][0]), end=float(records[name][0][-1]), within=with_it[name],
            elsewhere=min(others), throughout=True,
        )
        for name in against
    }  # fmt: skip


def _mirrored(y: np.ndarray, x: np.ndarray, part: np.ndarray) -> tuple[int, int] | None:
    """The samples (begin, end) where the rest of the record foretells y (n,) with the sign of y, or of what moves it,
    turned round.

    They are looked for near a `part` (n,) bool; None where the rest does not foretell it so.
    """
    for _ in range(ROUNDS):
        slope, level = np.polyfit(x[~part], y[~part], 1)
        if slope <= 0.0:
            return None
        with_it = (y - slope * x - level) ** 2
        against = min(
            ((y + slope * x + sign * level) ** 2 for sign in (1.0, -1.0)),
            key=lambda squares: float(np.sum(squares[part])),
        )
        begin, end = _largest(with_it - against)
        part = np.zeros(len(y), dtype=bool)
        part[begin:end] = True
        if not SHORT * len(y) <= end - begin <= (1.0 - SHORT) * len(y) or np.std(x[part]) < STIRS * np.std(x[~part]):
            return None
    beside = (x[part] >= np.min(x[~part])) & (x[part] <= np.max(x[~part]))
    if np.mean(beside) < BESIDE:  # a plant whose response has a valley looks the same
        return None
    # pyrefly: ignore[unbound-name]  (there was a round)
    return (begin, end) if np.mean(against[part]) <= MISSED * np.var(y[part]) else None


def _largest(gains: np.ndarray) -> tuple[int, int]:
    """The stretch (begin, end) of a series (n,) with the largest sum."""
    sums = np.concatenate([[0.0], np.cumsum(gains)])
    least = np.minimum.accumulate(sums)
    end = int(np.argmax(sums - least))
    return int(np.argmin(sums[: end + 1])), end


def _passes(x: np.ndarray) -> int:
    """How often a signal passes zero."""
    return int(np.sum(np.diff(np.signbit(x).astype(int)) != 0))


def _correlation(sums: np.ndarray, count: int) -> float:
    """From the sums of y, x, y^2, x^2 and xy of so many samples."""
    y, x, yy, xx, yx = sums / count
    size = max(yy - y * y, 0.0) * max(xx - x * x, 0.0)
    return float((yx - y * x) / np.sqrt(size)) if size > 1e-24 * max(yy * xx, 1e-300) else 0.0
