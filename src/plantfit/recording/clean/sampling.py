"""Sampling periods, stretches without gaps, and new recordings from old: what the cleaning steps share."""

from collections.abc import Callable

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.readers.columns import close_match
from plantfit.recording.record import Recording, Signal

_MEAN = 1e-6  # share of the median step by which the mean may differ, for its rounding


def period_of(recording: Recording) -> float:
    """The median step in seconds; raises RecordingError for fewer than two samples."""
    if len(recording) < 2:
        raise RecordingError(
            f"Recording {recording.name!r} has only one sample, so it has no sampling period; use a longer recording."
        )
    return float(np.median(np.diff(recording.t)))


def usual_period(recording: Recording) -> float:
    """The period (s) of a clock whose times were rounded when they were written, as minutes with five digits are: the
    mean of the steps that are within a tenth of the median, to six digits. Gaps do not count."""
    period, steps = period_of(recording), np.diff(recording.t)
    mean = float(np.mean(steps[np.abs(steps - period) <= 0.1 * period]))
    return float(f"{mean:.6g}") if abs(mean - period) > _MEAN * period else period


def uniform_period(recording: Recording, step: str) -> float:
    """The period of a recording whose steps differ by less than a tenth; raises RecordingError otherwise.

    It is the mean step where that differs from the median: of a clock that rounds 20.4 ms to 20 and 21 ms the median is
    20 ms.
    """
    period = period_of(recording)
    steps = np.diff(recording.t)
    worst = int(np.argmax(np.abs(steps - period)))
    if abs(steps[worst] - period) > 0.1 * period:
        raise RecordingError(
            f"Recording {recording.name!r}: {step} needs even steps, but after {recording.t[worst]:g} s "
            f"the step is {steps[worst]:g} s instead of {period:g} s; resample it first (step resample, "
            f"period = {period:g}; in Python resample(recording, {period:g})), or cut it there."
        )
    mean = float(recording.t[-1] - recording.t[0]) / len(steps)
    return mean if abs(mean - period) > _MEAN * period else period


def signal_of(recording: Recording, name: str) -> Signal:
    """The signal; raises RecordingError with the closest name."""
    if name not in recording.signals:
        hint = close_match(str(name), recording.signals)
        raise RecordingError(
            f"Recording {recording.name!r} has no signal {name!r}{hint}; it has {list(recording.signals)}."
        )
    return recording.signals[name]


def with_signal(recording: Recording, name: str, values: np.ndarray, unit: str | None, sentence: str) -> Recording:
    """The recording with one signal replaced or added, and a sentence in its log."""
    signals = {**recording.signals, name: Signal(values, unit)}
    return Recording(recording.t, signals, recording.name, (*recording.log, sentence), recording.clocked)


def with_new(
    recording: Recording, name: str, values: np.ndarray, unit: str | None, sentence: str, step: str
) -> Recording:
    """`with_signal` for a signal that must not be there yet; raises RecordingError in the name of `step`."""
    if name in recording.signals:
        raise RecordingError(
            f"{step}: recording {recording.name!r} already has a "
            f"signal {name!r}; give another name, or rename that one."
        )
    return with_signal(recording, name, values, unit, sentence)


def by_stretch(values: np.ndarray, shortest: int, function: Callable[[np.ndarray, slice], np.ndarray]) -> np.ndarray:
    """`function(values[part], part)` on every stretch without NaN of at least `shortest` samples; NaN elsewhere."""
    result = np.full(values.shape, np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(values), [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        if stop - start >= shortest:
            part = slice(int(start), int(stop))
            result[part] = function(values[part], part)
    return result


def lost(before: np.ndarray, after: np.ndarray) -> str:
    """ " (k samples in short stretches became missing)" or nothing."""
    count = int(np.sum(np.isfinite(before) & ~np.isfinite(after)))
    return f"; {count} samples in stretches too short for it became missing" if count else ""


def require_positive(value: float, what: str) -> float:
    """The value as a float; raises RecordingError unless finite and above 0."""
    if not (
        isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and np.isfinite(value) and value > 0
    ):
        raise RecordingError(f"{what} is {value!r}; give a number above 0.")
    return float(value)


def require_odd(window: int, what: str, at_least: int) -> int:
    """The window as an int; raises RecordingError unless odd and large enough."""
    if not isinstance(window, (int, np.integer)) or window % 2 == 0 or window < at_least:
        raise RecordingError(f"{what}: window is {window!r}; give an odd whole number of samples, at least {at_least}.")
    return int(window)
