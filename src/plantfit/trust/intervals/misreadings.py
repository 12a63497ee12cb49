"""Intervals that allow for the steps in which inputs were read, and for the noise of their readings.

A speed made of an encoder's counts, or a voltage of a coarse converter, is the plant's input and an error of less than
a step. The model is driven by both, so that this error is carried through the plant and moves its parameters; residuals
show little of what is slow in it. How much it moves them is told by other readings of the same motion: the input as a
smooth curve, read in the same steps that lie elsewhere, 16 times over a step (`recording/signals/unrounded.py`). The
squares of the moves of the least-squares answer, to first order, are the variance that steps add. Of readings with
noise other ones have other noise more.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.findings.parameters import Determined
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.measure.long_run import NORMAL
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look
from plantfit.recording.record import Recording
from plantfit.recording.signals.unrounded import renoised, reread
from plantfit.trust.intervals.linearised import Local, named_blocks
from plantfit.trust.intervals.parameter_rows import judged
from plantfit.trust.intervals.ranges import Range
from plantfit.trust.looks.misreadings import Misreading, misreading_looks, misreadings

PLACES = 16  # of the steps, at which readings are made
DRAWN = 2  # times as many of noise, which is drawn and not spread evenly
NOTICED = 1.05  # times a standard error from which on steps are allowed for
TOLD = 1.25  # times it from which on they are spoken of
FIRST, NEAR = 4, 0.3  # readings that are made first, and the share of a noticed move from which on all are made
# of the correlation that steps leave, two standard errors above what residuals show: the plant got what was read
REFUTED = 0.2
LAGS = 50  # samples over which the correlation of residuals is looked at
RCOND = 1e-12  # of the largest singular value: directions below are open

Row = dict[str, Any]


def allowing_for_misreadings(
    problem: Problem, z: np.ndarray, local: Local, rows: Sequence[Row]
) -> tuple[list[Row], list[Look]]:
    """The rows of the parameters at the answer z (d,), wider where steps of inputs move them, and a look at every such
    input.

    "by_steps" of a row is the standard uncertainty by the steps alone. Where they widen no interval by a twentieth,
    nothing changes and no row has one; where none by a quarter, there are no looks.
    """
    plain = [{**row, "by_steps": None} for row in rows]
    steps = misreadings(problem)
    places = {n: i for i, n in enumerate(problem.space.names)}
    if not steps or not any(_bounded(row) for row in rows):
        return plain, []
    if not _may_matter(rows, places, moves(problem, z, local, steps, FIRST).values):
        return plain, []
    moved = moves(problem, z, local, steps)
    if _refuted(moved, steps):
        return plain, []
    wider = [
        _wider(row, problem, local, places[row["name"]], moved.values) if row["name"] in places else row
        for row in plain
    ]
    times = max(
        w["standard_error"] / row["standard_error"] for w, row in zip(wider, rows, strict=True) if _bounded(row)
    )
    return wider if times > NOTICED else plain, misreading_looks(problem, steps, moved.left) if times > TOLD else []


def claimed(determined: Determined | None, rows: Sequence[Row]) -> Determined | None:
    """The section "determined" without what it says, by the noise alone, of parameters that steps move more than the
    noise does."""
    moved = {row["name"] for row in rows if row["by_steps"] and 2.0 * row["by_steps"] ** 2 > row["standard_error"] ** 2}
    if determined is None or not moved:
        return determined
    kept = [c for c in determined.combinations if not moved & set(c.weights)]
    count = determined.count - len(determined.combinations) + len(kept)
    only_if = {n: other for n, other in determined.only_if.items() if n not in moved and other.known not in moved}
    return determined.model_copy(update={"combinations": kept, "count": count, "directions": count, "only_if": only_if})


class Moves(NamedTuple):
    """What steps do, root mean square over other readings: to the `values` (d,) in their units, and to the
    residuals, where `left` is the mean square that the parameters do not take in, over that of the residuals. Which
    share of the correlation that it has from sample to sample the residuals have, is `shown`, with the standard
    `error` of that where the plant got what was read."""

    values: np.ndarray
    left: float
    shown: float
    error: float


def _may_matter(rows: Sequence[Row], places: Mapping[str, int], moved: np.ndarray) -> bool:
    """Whether moves (d,) of few readings come near what would be noticed."""
    least = NEAR * np.sqrt(NOTICED**2 - 1.0)
    return any(
        _bounded(row) and row["name"] in places and moved[places[row["name"]]] > least * row["standard_error"]
        for row in rows
    )


def moves(problem: Problem, z: np.ndarray, local: Local, steps: Sequence[Misreading], count: int = PLACES) -> Moves:
    """By how much steps move the values and the residuals, of so many other readings; parameters that a bound holds
    do not move."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    j = np.where([b is None for b in local.at_bound], jacobian / norms, 0.0)
    smoothing = 0.0 if problem.smoothing is None else problem.smoothing.matrix / norms[:, None] / norms[None, :]
    solve = -np.linalg.pinv(j.T @ j + smoothing, rcond=RCOND, hermitian=True) @ j.T / norms[:, None]
    recordings = {n: e.recording for n, e in problem.experiments.items()}
    rows: dict[str, list[slice]] = {}
    for name, _, block in named_blocks(problem):
        rows.setdefault(name, []).append(block.rows)
    blocks = [at for own in rows.values() for at in own]
    squares, left, expected = np.zeros(len(z)), 0.0, np.zeros(LAGS + 1)
    for error in dict.fromkeys((s.signal, s.kind) for s in steps):
        read = {
            s.recording: _read_again(recordings[s.recording], s, count) for s in steps if (s.signal, s.kind) == error
        }
        times = DRAWN * count if error[1] == "noisy" else count
        for k in range(times):
            there = np.asarray(
                problem.with_recordings(recordings | {n: r[k] for n, r in read.items()}).unsmoothed.residuals(z)
            )
            for own in rows.values():  # each recording errs by itself
                squares += sum(solve[:, at] @ (there[at] - residuals[at]) for at in own) ** 2 / times
            change = there - residuals
            rest = change + (j * norms) @ (solve @ change)
            left += float(np.sum(rest**2)) / times
            expected += _products(rest, blocks) / times
    shown, error = _share(_products(residuals, blocks), expected, len(residuals))
    return Moves(
        np.sqrt(squares) * problem.space.slopes(z), left / max(float(np.sum(residuals**2)), 1e-300), shown, error
    )


def _refuted(moved: Moves, steps: Sequence[Misreading]) -> bool:
    """Whether residuals say that the plant got what was read, of steps that nobody told. What noise leaves in a plant
    that sums its input up wanders, and shows a tenth of its correlation or twice of it in one record: residuals have
    to show none."""
    if any(s.told for s in steps) or moved.shown + 2.0 * moved.error >= REFUTED:
        return False
    return not any(s.kind == "noisy" for s in steps) or moved.shown < 3.0 * moved.error


def _read_again(recording: Recording, s: Misreading, count: int) -> list[Recording]:
    """The recording with so many other errors of an input of the same kind."""
    if s.kind == "noisy":
        return renoised(recording, s.signal, s.size, DRAWN * count)
    return reread(recording, s.signal, s.size, count, s.kind == "counted")


def _products(series: np.ndarray, blocks: Sequence[slice]) -> np.ndarray:
    """Sums of products of samples that are 0, 1, .. `LAGS` apart, over all blocks of a series (n,)."""
    found = np.zeros(LAGS + 1)
    for own in (series[at] for at in blocks):
        for k in range(min(LAGS + 1, len(own))):
            found[k] += float(own[: len(own) - k] @ own[k:])
    return found


def _share(seen: np.ndarray, expected: np.ndarray, count: int) -> tuple[float, float]:
    """Which share of the correlation that steps leave in residuals is seen there, and its standard error where they
    leave none."""
    weight = max(float(expected[1:] @ expected[1:]), 1e-300)
    return float(expected[1:] @ seen[1:]) / weight, seen[0] / np.sqrt(weight * max(count, 1))


def _bounded(row: Row) -> bool:
    return bool(row["standard_error"]) and row["status"] in ("determined", "weak") and not row.get("open")


def _wider(row: Row, problem: Problem, local: Local, at: int, moved: np.ndarray) -> Row:
    """The row with a standard error, an interval and a status that hold for what steps add, and what that is."""
    if not _bounded(row) or not np.isfinite(moved[at]):
        return row
    coordinate, by_steps, value = problem.space.coordinates[at], float(moved[at]), row["value"]
    least, most = coordinate.limits
    low = float(max(least, value - np.hypot(value - row["low"], NORMAL * by_steps)))
    high = float(min(most, value + np.hypot(row["high"] - value, NORMAL * by_steps)))
    status = row["status"]
    if status == "determined":
        status = judged(coordinate, value, Range(low, high), local.linear is None or local.linear.sound)
    return {
        **row, "standard_error": float(np.hypot(row["standard_error"], by_steps)), "low": low, "high": high,
        "status": "weak" if status == "flat" else status, "by_steps": by_steps,
    }  # fmt: skip


__all__ = ["Moves", "allowing_for_misreadings", "claimed", "moves"]
