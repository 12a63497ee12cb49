"""Records of unequal length as rows of chunks of one shape, so that one compiled loop serves them all.

Every record becomes intervals that end at its samples (the first has length 0), cut into chunks of
`size` intervals. Chunks of one record follow one another in a row; a row takes the next record when
it has finished one. A chunk in which the late edge of a delayed input can fall is a window: its
steps also end at these edges.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.simulate.simulator import Drive

SIZES = (64, 128, 256, 512, 1024, 2048, 4096)
PADDING = 0.2  # largest share of steps that only fill up rows


@dataclass(frozen=True)
class Track:
    """One record: its drive, per output what was measured and which samples are scored (N,), and the range of every
    delay (s)."""

    drive: Drive
    measured: tuple[np.ndarray, ...]
    scored: tuple[np.ndarray, ...]  # bool
    delays: tuple[tuple[float, float], ...]


class Knots(NamedTuple):
    """A delayed input around a chunk, as in `grid.Pieces`; arrays (M, E, R) and (M, E + 1, R)."""

    value: Any
    slope: Any
    origin: Any
    knots: Any


class Chunks(NamedTuple):
    """M chunks in R rows of C intervals; a pytree of numbers. Everything is (M, C, R) unless said."""

    lane: Any  # (M, R) which record
    first: Any  # (M, R) whether the record begins here
    window: Any  # (M,) whether edges of delayed inputs can fall into the chunk
    t: Any  # (M, C + 1, R) s
    start: tuple[Any, ...]  # per channel but time: value at the start of the interval, of a delayed one at delay 0
    slope: tuple[Any, ...]  # per channel but time: None when held
    at: tuple[Any, ...]  # per input: value at the end of the interval, on its right side
    knots: tuple[Knots, ...]  # per delayed channel
    measured: tuple[Any, ...]
    scored: tuple[Any, ...]  # bool


@dataclass(frozen=True)
class Schedule:
    """`chunks` with what shapes a program: rows, size, and whether windows are in none, all or some of the chunks."""

    chunks: Chunks
    rows: int
    size: int
    windows: str  # "none", "all", "some"
    place: tuple[np.ndarray, ...]  # per track (N,): flat position (m, c, r) of every sample


def make_schedule(tracks: Sequence[Track], interpolated: Sequence[bool], rows: int | None = None) -> Schedule:
    """Cut and place `tracks`; `interpolated` tells for every channel but time whether it is linear between samples.

    `rows` None takes as many rows as keep the filling under 20 %.
    """
    size = min(SIZES, key=lambda c: _steps(tracks, c))
    counts = [-(-len(k.drive.t) // size) for k in tracks]
    rows = rows or _rows(counts)
    placed, length = _packed(counts, rows)
    e = tuple(_most_knots(tracks, size, i) for i in range(len(tracks[0].delays)))
    pieces = [[_chunk(k, c, size, e, interpolated) for c in range(n)] for k, n in zip(tracks, counts, strict=True)]
    idle = _idle(pieces[0][0])
    grid = [[idle] * rows for _ in range(length)]
    lane, first = np.zeros((length, rows), np.int32), np.zeros((length, rows), bool)
    place = []
    for k, (row, begin) in enumerate(placed):
        for c in range(counts[k]):
            grid[begin + c][row] = pieces[k][c]
            lane[begin + c, row], first[begin + c, row] = k, c == 0
        n = np.arange(len(tracks[k].drive.t))
        place.append(((begin + n // size) * size + n % size) * rows + row)
    for row in range(rows):
        k = max((k for k, (own, _) in enumerate(placed) if own == row), key=lambda k: placed[k][1])
        lane[placed[k][1] :, row] = k  # also where the row is idle afterwards
    stacked = _stack(grid)
    live = [np.any(np.isfinite(q.knots), axis=(1, 2)) for q in stacked["knots"]]
    window = np.any(live, axis=0) if live else np.zeros(length, bool)
    windows = "none" if not window.any() else "all" if window.all() else "some"
    return Schedule(Chunks(lane, first, window, **stacked), rows, size, windows, tuple(place))


def _rows(counts: Sequence[int]) -> int:
    """The most rows that waste under 20 %."""
    for rows in range(len(counts), 1, -1):
        length = _packed(counts, rows)[1]
        if rows * length * (1 - PADDING) <= sum(counts):
            return rows
    return 1


def _packed(counts: Sequence[int], rows: int) -> tuple[list[tuple[int, int]], int]:
    """Row and first chunk of every record, longest first into the emptiest row; and the length of the longest row."""
    load, placed = [0] * rows, [(0, 0)] * len(counts)
    for k in sorted(range(len(counts)), key=lambda k: -counts[k]):
        row = min(range(rows), key=lambda r: load[r])
        placed[k] = (row, load[row])
        load[row] += counts[k]
    return placed, max(load)


def _steps(tracks: Sequence[Track], size: int) -> float:
    """Steps of the longest way through all records in chunks of this size, as a measure of work."""
    total = 0.0
    spread = [_most_knots(tracks, size, i) for i in range(len(tracks[0].delays))]
    for k in tracks:
        chunks = -(-len(k.drive.t) // size)
        live = sum(any(len(_near(k, i, c, size)) for i in range(len(k.delays))) for c in range(chunks))
        total += chunks * size + live * (sum(spread) + 0.5 * size)  # windows cost more for each step
    return total


def _near(track: Track, channel: int, c: int, size: int) -> np.ndarray:
    """Knots of a delayed channel that can fall into chunk c."""
    t, knots = track.drive.t, track.drive.delayed[channel].knots
    low, high = track.delays[channel]
    begin, end = t[max(c * size - 1, 0)], t[min((c + 1) * size, len(t)) - 1]
    return np.flatnonzero((knots + low <= end) & (knots + high >= begin))


def _most_knots(tracks: Sequence[Track], size: int, channel: int) -> int:
    return max(len(_near(k, channel, c, size)) for k in tracks for c in range(-(-len(k.drive.t) // size)))


def _chunk(track: Track, c: int, size: int, most: Sequence[int], interpolated: Sequence[bool]) -> dict[str, Any]:
    """One chunk of one record; the last is filled up with intervals of length 0 that are not scored."""
    d = track.drive
    n = len(d.t)
    k = np.minimum(np.arange(c * size, (c + 1) * size), n - 1)
    before = np.maximum(k - 1, 0)
    before = np.where(np.arange(c * size, (c + 1) * size) > n - 1, n - 1, before)
    real = np.arange(c * size, (c + 1) * size) < n
    start, slope, at, knots = [], [], [], []
    for value, rate, linear in zip(d.value, d.slope, interpolated, strict=False):
        start.append(value[before])
        slope.append(rate[before] if linear else None)
        at.append(value[k])
    late = interpolated[len(d.value) :]
    for i, (pieces, linear) in enumerate(zip(d.delayed, late, strict=True)):
        near = _near(track, i, c, size)
        low = track.delays[i][0]
        # without knots nearby one piece holds throughout: the one of the earliest possible time
        passed = int(near[0]) if len(near) else int(np.searchsorted(pieces.knots + low, d.t[before[0]], side="right"))
        v, s, o = pieces.value[passed], pieces.slope[passed], pieces.origin[passed]
        start.append(v + s * (d.t[before] - o))
        slope.append(np.full(size, s) if linear else None)
        own = slice(passed, passed + len(near) + 1)
        fill = (0, most[i] - len(near))
        own_value, own_slope, own_origin = (
            np.pad(a[own], fill, mode="edge") for a in (pieces.value, pieces.slope, pieces.origin)
        )
        knots.append(Knots(own_value, own_slope, own_origin, np.pad(pieces.knots[near], fill, constant_values=np.inf)))
    scored = [real & w[k] for w in track.scored]
    measured = [np.where(w, y[k], 0.0) for y, w in zip(track.measured, scored, strict=True)]
    t = np.r_[d.t[before[0]], d.t[k]]
    return {
        "t": t, "start": tuple(start), "slope": tuple(slope), "at": tuple(at), "knots": tuple(knots),
        "measured": tuple(measured), "scored": tuple(scored),
    }  # fmt: skip


def _idle(like: Mapping[str, Any]) -> dict[str, Any]:
    """A chunk that changes nothing, for the end of rows that are shorter than the longest."""

    def still(a):
        return np.full_like(a, a[0]) if a is not None else None

    quiet = tuple(
        Knots(
            np.full_like(q.value, q.value[0]),
            np.zeros_like(q.slope),
            np.full_like(q.origin, q.origin[0]),
            np.full_like(q.knots, np.inf),
        )
        for q in like["knots"]
    )
    return {
        "t": still(like["t"]),
        "start": tuple(still(a) for a in like["start"]),
        "slope": tuple(None if a is None else np.zeros_like(a) for a in like["slope"]),
        "at": tuple(still(a) for a in like["at"]),
        "knots": quiet,
        "measured": tuple(np.zeros_like(a) for a in like["measured"]),
        "scored": tuple(np.zeros_like(a) for a in like["scored"]),
    }


def _stack(grid: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, Any]:
    """Chunks [m][r] of mappings to a mapping of arrays (M, ..., R)."""

    def join(pick):
        return np.stack([np.stack([pick(cell) for cell in line], axis=-1) for line in grid])

    model = grid[0][0]
    result: dict[str, Any] = {"t": join(lambda q: q["t"])}
    for name in ("start", "slope", "at", "measured", "scored"):
        result[name] = tuple(
            None if model[name][i] is None else join(lambda q, name=name, i=i: q[name][i])
            for i in range(len(model[name]))
        )
    result["knots"] = tuple(
        Knots(*(join(lambda q, i=i, part=part: getattr(q["knots"][i], part)) for part in Knots._fields))
        for i in range(len(model["knots"]))
    )
    return result
