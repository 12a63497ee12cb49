"""Records cut into segments of one shape, so that all of them are simulated side by side.

A segment keeps the true history of delayed inputs: it has the knots that can reach it for any delay inside its bounds.
"""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive
from plantfit.simulate.steps.grid import Pieces

import jax


class Segments(NamedTuple):
    """L segments of at most T samples, padded by repeating the last one (steps of length zero); a pytree.

    The sample where two segments meet is the last of one and the first of the next, and scored in the next only.
    """

    drive: Drive  # every array with a leading axis L
    measured: tuple[Any, ...]  # per output (L, T), 0 where nothing is scored
    scored: tuple[Any, ...]  # per output (L, T) bool
    first: Any  # (L,) bool: begins a record, so that the model gives its initial state


class Cut(NamedTuple):
    """Segments with what stays outside of compiled functions."""

    segments: Segments
    record: np.ndarray  # (L,) number of the record of every segment
    local: np.ndarray  # (L, q) coordinates of the space that enter a segment


def cut(problem: Problem, segments: int | None = None, length: float | None = None) -> Cut:
    """Cut the fitted part of every record into pieces of `length` seconds, or the longest record into `segments`
    pieces.

    Raises SearchError for a length or number that does not fit the records.
    """
    drives = problem.data["drive"]
    length = _length([d.t for d in drives.values()], segments, length)
    outputs, delays = problem.outputs, problem.predictor.stepping().vector.model.delays
    pieces, record, local = [], [], []
    for k, (name, drive) in enumerate(drives.items()):
        y, scored = _full(problem, name, len(drive.t))
        low, high = (problem.space.tree(bound, name) for bound in (problem.space.lower, problem.space.upper))
        ranges = [(float(low[d.parameter]), float(high[d.parameter])) for d in delays]
        bounds = _bounds(drive.t, length)
        for i, (a, b) in enumerate(bounds):
            pieces.append(_Piece(drive, y, scored, ranges, a, b, i == 0, i == len(bounds) - 1))
            record.append(k)
            local.append(problem.space.local(name))
    most = max(p.stop - p.start for p in pieces) + 1
    knots = [max(p.knots(j)[1] - p.knots(j)[0] for p in pieces) for j in range(len(delays))]
    stacked = jax.tree.map(lambda *a: np.stack(a), *(p.padded(most, knots, len(outputs)) for p in pieces))
    return Cut(stacked, np.array(record), np.stack(local))


def _length(times: Sequence[np.ndarray], segments: int | None, length: float | None) -> float:
    if (segments is None) == (length is None):
        raise SearchError("Multiple shooting needs either segments (a number) or length (seconds); give one of them.")
    longest = max(times, key=lambda t: t[-1] - t[0])
    span, most = float(longest[-1] - longest[0]), len(longest) - 1
    if segments is not None:
        if segments < 1 or segments > most:
            raise SearchError(
                f"segments = {segments}, but the longest record has {most + 1} samples; give 1 to {most}."
            )
        return max(span, 1e-300) / segments
    assert length is not None
    if not (np.isfinite(length) and length > 0):
        raise SearchError(f"length = {length:g} s of a shooting segment; give a positive time.")
    if span / length > most:
        raise SearchError(
            f"length = {length:g} s of a shooting segment is less than the time between two samples; give a longer one."
        )
    return float(length)


def _bounds(t: np.ndarray, length: float) -> list[tuple[int, int]]:
    """First and last sample of every segment."""
    count = max(1, round((t[-1] - t[0]) / length))
    marks = t[0] + (t[-1] - t[0]) * np.arange(1, count) / count
    edges = np.unique(np.r_[0, np.searchsorted(t, marks - 1e-9 * length), len(t) - 1])
    return list(itertools.pairwise(edges.tolist())) or [(0, 0)]


def _full(problem: Problem, name: str, n: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per output the measured values (n,), 0 where not scored, and what is scored (n,)."""
    y, scored = [np.zeros(n) for _ in problem.outputs], [np.zeros(n, bool) for _ in problem.outputs]
    for i, output in enumerate(problem.outputs):
        index = problem.data["drive"][name].places(problem.data["index"][name][output])
        y[i][index], scored[i][index] = problem.data["measured"][name][output], True
    return y, scored


class _Piece(NamedTuple):
    """Samples start..stop of one record."""

    drive: Drive
    y: list[np.ndarray]
    scored: list[np.ndarray]
    delays: list[tuple[float, float]]
    start: int
    stop: int
    is_first: bool
    is_last: bool

    def knots(self, j: int) -> tuple[int, int]:
        """The knots of delayed channel j that can fall inside the segment."""
        low, high = self.delays[j]
        t, knots = self.drive.t, self.drive.delayed[j].knots
        return int(np.searchsorted(knots, t[self.start] - high)), int(
            np.searchsorted(knots, t[self.stop] - low, side="right")
        )

    def padded(self, most: int, knots: list[int], outputs: int) -> Segments:
        at = np.minimum(self.start + np.arange(most), self.stop)
        own = np.arange(most) < self.stop - self.start + self.is_last
        drive = Drive(
            self.drive.t[at],
            tuple(v[at] for v in self.drive.value),
            tuple(s[at] for s in self.drive.slope),
            tuple(self._late(j, n) for j, n in enumerate(knots)),
            tuple(np.asarray(v) for v in self.drive.first_input),
            tuple(np.asarray(v) for v in self.drive.first_output),
        )
        return Segments(
            drive,
            tuple(self.y[i][at] for i in range(outputs)),
            tuple(self.scored[i][at] & own for i in range(outputs)),
            np.asarray(self.is_first),
        )

    def _late(self, j: int, most: int) -> Pieces:
        pieces, (i0, i1) = self.drive.delayed[j], self.knots(j)
        at = np.minimum(i0 + np.arange(most + 1), i1)
        knots = np.r_[pieces.knots[i0:i1], np.full(most - (i1 - i0), np.inf)]
        return Pieces(pieces.value[at], pieces.slope[at], pieces.origin[at], knots)
