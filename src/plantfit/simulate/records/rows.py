"""Records of unequal length as rows of intervals, one row each, for loops whose rows have their own number of steps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.simulate.records.schedule import Knots, Track

import jax

LANES = 16  # that take about as long as one
PADDED = 4.0  # times the samples that rows of the longest record may have
EVEN = 2.0  # times the samples that records side by side may take


class Records(NamedTuple):
    """L records of at most K intervals that end at samples; a pytree of numbers. Everything is (L, K) unless said.

    Behind the last sample of a record intervals have length 0 and are not scored.
    """

    used: Any  # (L,) intervals of the record
    late: Any  # whether edges of delayed inputs can fall into the interval
    begin: Any  # s, of the interval
    end: Any
    start: tuple[Any, ...]  # per channel but time: value at the start of the interval, of a delayed one at delay 0
    slope: tuple[Any, ...]  # per channel but time: None when held
    at: tuple[Any, ...]  # per input: value at the end of the interval, on its right side
    knots: tuple[Knots, ...]  # per delayed channel, around the interval: (L, K, E) and (L, K, E + 1)
    measured: tuple[Any, ...]
    scored: tuple[Any, ...]  # bool


@dataclass(frozen=True)
class RecordRows:
    """`records` with what shapes a program: whether edges of delayed inputs are near none, all or some of the
    intervals."""

    records: Records
    steps_first: Records  # with axes (K, L) for (L, K)
    windows: str  # "none", "all", "some"

    @property
    def even(self) -> bool:
        """Whether records are so alike in length that they can go on side by side to the end of the longest."""
        return self.records.late.size <= EVEN * int(np.sum(self.records.used))

    @property
    def compiled_in(self) -> tuple[Any, ...]:
        """What a program depends on beside the shapes: near edges, and what `even` and `together` look at."""
        return self.windows, self.records.late.shape, int(np.sum(self.records.used))

    def together(self, candidates: int) -> bool:
        """Whether it takes less time to go through all records together, with one candidate after the other, than the
        other way round.

        Of few lanes a step takes about as long as of many.
        """
        count, length = self.records.late.shape
        return 2 * candidates * length * -(-count // LANES) < int(np.sum(self.records.used))


def filled(tracks: Sequence[Track]) -> bool:
    """Whether records are alike enough in length for rows of the longest."""
    lengths = [len(k.drive.t) for k in tracks]
    return len(lengths) * max(lengths) <= PADDED * sum(lengths)


def make_rows(tracks: Sequence[Track], interpolated: Sequence[bool]) -> RecordRows:
    """`interpolated` tells for every channel but time whether it is linear between samples."""
    most = tuple(max(int(np.max(_near(k, i)[1])) for k in tracks) for i in range(len(tracks[0].delays)))
    longest = max(len(k.drive.t) for k in tracks)
    rows = [_row(k, longest, most, interpolated) for k in tracks]
    used = np.array([len(k.drive.t) for k in tracks])
    live = [r.late[: len(k.drive.t)] for r, k in zip(rows, tracks, strict=True)]
    windows = "none" if not any(np.any(a) for a in live) else "all" if all(np.all(a) for a in live) else "some"
    joined = Records(used, *(_joined([r[i] for r in rows]) for i in range(1, len(Records._fields))))
    turned = jax.tree.map(lambda a: np.ascontiguousarray(np.swapaxes(a, 0, 1)) if a.ndim > 1 else a, joined)
    return RecordRows(joined, turned, windows)


def _joined(values: Sequence[Any]) -> Any:
    """Arrays of the records, or tuples of them, stacked."""
    if values[0] is None:
        return None
    if isinstance(values[0], Knots):
        return Knots(*(_joined(parts) for parts in zip(*values, strict=True)))
    if isinstance(values[0], tuple):
        return tuple(_joined(parts) for parts in zip(*values, strict=True))
    return np.stack(values)


def _near(track: Track, channel: int) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the first knot of a delayed channel that can fall into each interval or after it, and how many can fall
    into it."""
    t, knots = track.drive.t, np.asarray(track.drive.delayed[channel].knots)
    low, high = track.delays[channel]
    begin = np.r_[t[:1], t[:-1]]
    first = np.searchsorted(knots + high, begin, side="left")
    return first, np.maximum(np.searchsorted(knots + low, t, side="right") - first, 0)


def _row(track: Track, length: int, most: Sequence[int], interpolated: Sequence[bool]) -> Records:
    d, n = track.drive, len(track.drive.t)
    k = np.minimum(np.arange(length), n - 1)
    real = np.arange(length) < n
    before = np.where(real, np.maximum(k - 1, 0), n - 1)
    begin, end = d.t[before], d.t[k]
    start = [v[before] for v in d.value]
    slope = [s[before] if linear else None for s, linear in zip(d.slope, interpolated, strict=False)]
    late, knots = np.zeros(length, bool), []
    for i, (pieces, linear) in enumerate(zip(d.delayed, interpolated[len(d.value) :], strict=True)):
        first, count = (a[k] for a in _near(track, i))
        count = np.where(real, count, 0)
        # an edge at the very end of an interval moves with the delay into it: it counts, as in `schedule`
        late |= count > 0
        own = first[:, None] + np.minimum(np.arange(most[i] + 1), count[:, None])
        value, rate, origin = (np.asarray(a)[own] for a in (pieces.value, pieces.slope, pieces.origin))
        numbers = np.arange(most[i])
        edges = (
            np.asarray(pieces.knots)[np.minimum(first[:, None] + numbers, len(pieces.knots) - 1)]
            if len(pieces.knots)
            else np.inf
        )
        knots.append(Knots(value, rate, origin, np.where(numbers < count[:, None], edges, np.inf)))
        start.append(value[:, 0] + rate[:, 0] * (d.t[before] - origin[:, 0]))
        slope.append(rate[:, 0] if linear else None)
    scored = [real & w[k] for w in track.scored]
    measured = [np.where(w, y[k], 0.0) for y, w in zip(track.measured, scored, strict=True)]
    at = tuple(v[k] for v in d.value)
    return Records(
        np.array(n), late, begin, end, tuple(start), tuple(slope), at, tuple(knots), tuple(measured), tuple(scored)
    )


__all__ = ["RecordRows", "Records", "make_rows"]
