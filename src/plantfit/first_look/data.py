"""Inputs and outputs of a recording on an even clock, as all first looks take them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording

FEWEST = 30  # samples
LOST = 0.2  # share of an input that may be missing


@dataclass(frozen=True)
class Data:
    """One recording: `inputs` (n, m) and one output `y` (n,), NaN where not measured, every `period` s; `fitted` and
    `unseen` (n,) bool.

    `at` (k,) are times of the recording's own samples in s from its first, where its clock is uneven. One that is
    `rested` begins as if it had rested at its first measured output; others have initial states of their own.
    """

    name: str
    period: float
    inputs: np.ndarray
    y: np.ndarray
    fitted: np.ndarray
    unseen: np.ndarray
    input_names: tuple[str, ...]
    output: str
    at: np.ndarray
    rested: bool = False


def data_of(recording: Recording, inputs: Sequence[str], output: str, fitted: np.ndarray | None = None,
            unseen: np.ndarray | None = None, period: float | None = None) -> Data:  # fmt: skip
    """One output of a recording with its inputs on the grid of its median period, or of `period` (s).

    Inputs are held from their last sample before, outputs are taken from the nearest sample; missing inputs are filled
    from the sample before. `fitted` and `unseen` (n,) bool; by default all samples are fitted. Raises RecordingError
    for fewer than FEWEST samples, for an input with over a fifth missing, for inputs of which none moves, and for an
    output that is not measured or does not move.
    """
    n, where = len(recording), f"Recording {recording.name!r}"
    if n < FEWEST:
        raise RecordingError(
            f"{where} has {n} sample{'s' * (n != 1)}, and a first "
            f"look needs {FEWEST} at least; give a longer recording."
        )
    fitted = np.ones(n, dtype=bool) if fitted is None else fitted
    unseen = np.zeros(n, dtype=bool) if unseen is None else unseen
    own = float(np.median(np.diff(recording.t)))
    step = own if period is None else period
    even = period is None and np.allclose(np.diff(recording.t), own, rtol=0.01, atol=0)
    at = recording.t - recording.t[0]
    columns = (
        np.column_stack([_filled(where, name, recording[name]) for name in inputs]) if inputs else np.zeros((n, 0))
    )
    if not columns.shape[1] or not np.any(np.ptp(columns, axis=0) > 0):
        what = (
            f"none of the inputs {', '.join(inputs)} moves"
            if len(inputs) > 1
            else f"input {', '.join(inputs) or '(none)'} never moves"
        )
        raise RecordingError(
            f"{where}: {what}, so that nothing can be said of what the output answers; record with the input moving."
        )
    y = np.asarray(recording[output], dtype=float)
    known = np.isfinite(y)
    if known.sum() < FEWEST:
        raise RecordingError(
            f"{where}: output {output} is measured at {int(known.sum())} samples, and {FEWEST} are needed at least."
        )
    if np.ptp(y[known]) == 0:
        raise RecordingError(f"{where}: output {output} is {y[known][0]:g} throughout; there is nothing to explain.")
    if not even:
        grid = step * np.arange(int(np.floor(at[-1] / step + 0.5)) + 1)
        held = np.clip(np.searchsorted(at, grid + 1e-9 * step, side="right") - 1, 0, n - 1)
        after = np.clip(held + 1, 0, n - 1)
        near = np.where(np.abs(at[after] - grid) < np.abs(at[held] - grid), after, held)
        far = np.abs(at[near] - grid) > 0.75 * step
        columns, y, fitted, unseen = (
            columns[held],
            np.where(far, np.nan, y[near]),
            fitted[near] & ~far,
            unseen[near] & ~far,
        )
    known = np.isfinite(y)
    return Data(recording.name, step, columns, y, fitted & known, unseen & known, tuple(inputs), output, at)


def _filled(where: str, name: str, values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    lost = ~np.isfinite(values)
    if not lost.any():
        return values
    if lost.mean() > LOST:
        raise RecordingError(
            f"{where}: input {name} is missing in {100 * lost.mean():.0f} % of the samples; give one that was recorded."
        )
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(values))))
    return np.where(lost[last], values[~lost][0], values[last])
