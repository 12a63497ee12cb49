"""Outliers: by the Hampel identifier, or named one by one."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import require_odd, require_positive, signal_of, with_signal
from plantfit.recording.record import Recording

# makes the median absolute deviation estimate the standard deviation of a normal distribution
_MAD_TO_SD = 1.4826
_WIDTHS, _LIMITS = (11, 7, 5, 3), (6.0, 10.0, 20.0, 40.0, 80.0)  # that `step_without` compares
_MOST_TIMES = 100  # that a study file lists


def drop_outliers(recording: Recording, name: str, window: int = 11, threshold: float = 4.0) -> Recording:
    """Mark as missing what is farther than `threshold` robust deviations from the running median of `window` samples.

    Pearson, Outliers in process modeling and identification, IEEE Trans. Control Syst. Technol. 10
    (2002). The deviation is never taken as smaller than the resolution of the signal, or steps of a
    quantised signal would count as outliers. Raises RecordingError for an even window.
    """
    signal = signal_of(recording, name)
    width = require_odd(window, f"drop_outliers({name!r})", 3)
    limit = require_positive(threshold, f"drop_outliers({name!r}): threshold")
    values = signal.values.copy()
    away, deviation = _from_median(values, width)
    out = away > limit * deviation
    values[out] = np.nan
    sentence = (
        f"{int(out.sum())} outliers of {name!r} dropped (running median of {width} samples, threshold {limit:g})."
    )
    return with_signal(recording, name, values, signal.unit, sentence)


def drop_samples(
    recording: Recording, name: str, times: Sequence[float] | None = None, between: Sequence[Sequence[float]] = ()
) -> Recording:
    """Mark as missing the samples of a signal at these times, s, each to half a sampling period, and those in stretches
    [start, stop].

    Raises RecordingError for a time at which there is no sample, and for a stretch without one.
    """
    signal, t = signal_of(recording, name), recording.t
    values = signal.values.copy()
    for stretch in between:
        values[_between(name, t, stretch)] = np.nan
    if times is None and len(between):
        count = int(np.sum(np.isnan(values) & ~np.isnan(signal.values)))
        told = (
            f"{count} samples of {name!r} dropped in {len(between)} stretch{'es' if len(between) > 1 else ''} of time."
        )
        return with_signal(recording, name, values, signal.unit, told)
    try:
        wanted = np.atleast_1d(np.asarray(times, dtype=float))
    except (TypeError, ValueError):
        wanted = np.zeros(0)
    if wanted.ndim != 1 or not wanted.size or not np.all(np.isfinite(wanted)):
        raise RecordingError(
            f"drop_samples({name!r}): times are {times!r}; give times of samples in seconds, as in [1.5, 2.25]."
        )
    at = np.clip(np.searchsorted(t, wanted), 1, len(t) - 1)
    at -= wanted - t[at - 1] < t[at] - wanted
    away = np.abs(t[at] - wanted) > 0.5 * float(np.median(np.diff(t)))
    if away.any():
        first = float(wanted[np.argmax(away)])
        raise RecordingError(
            f"drop_samples({name!r}): there is no sample at {first:g} s; "
            f"the recording has {t[0]:g} to {t[-1]:g} s, correct the time."
        )
    values[at] = np.nan
    return with_signal(
        recording, name, values, signal.unit, f"{len(np.unique(at))} samples of {name!r} dropped by their times."
    )


def _between(name: str, t: np.ndarray, stretch: Sequence[float]) -> np.ndarray:
    """Which samples (n,) a stretch [start, stop] holds."""
    try:
        start, stop = (float(v) for v in stretch)
    except (TypeError, ValueError):
        start = stop = np.nan
    inside = (t >= start) & (t <= stop)
    if not inside.any():
        raise RecordingError(
            f"drop_samples({name!r}): between holds {stretch!r}; give pairs [start, stop] in seconds "
            f"that hold samples, as in [[1.5, 2.25]]; the recording has {t[0]:g} to {t[-1]:g} s."
        )
    return inside


def step_without(name: str, values: np.ndarray, t: np.ndarray, marked: np.ndarray) -> tuple[dict[str, Any], int]:
    """The cleaning step that takes the `marked` (n,) bool samples of a signal (n,) and no others, and how many of them
    it takes.

    `drop_outliers` where some window and threshold do it; else `drop_samples`, for on the slopes of a signal that moves
    spikes hide from a running median. Of more than `_MOST_TIMES` it is the `drop_outliers` that comes nearest.
    """
    found: list[tuple[int, int, dict[str, Any]]] = []
    for width in _WIDTHS:
        away, deviation = _from_median(np.asarray(values, dtype=float), width)
        for limit in _LIMITS:
            out = away > limit * deviation
            step = {"step": "drop_outliers", "signal": name, "window": width, "threshold": limit}
            found.append((int(np.sum(out ^ marked)), int(np.sum(out & marked)), step))
    wrong, taken, step = min(found, key=lambda one: one[0])
    count = int(np.sum(marked))
    if wrong and count <= _MOST_TIMES:
        return {"step": "drop_samples", "signal": name, "times": [float(f"{v:.9g}") for v in t[marked]]}, count
    return step, taken


def inline(step: Mapping[str, Any]) -> str:
    """A cleaning step as a table in a line of a study file."""
    return f"{{ {', '.join(f'{key} = {json.dumps(value, ensure_ascii=False)}' for key, value in step.items())} }}"


def _from_median(values: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """How far each sample (n,) is from the running median of `width` samples, and the robust deviation there (n,);
    NaN where missing."""
    padded = np.pad(values, width // 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, width)
    there = np.isfinite(windows).any(axis=1)
    median, deviation = np.full((2, len(values)), np.nan)
    median[there] = np.nanmedian(windows[there], axis=1)
    deviation[there] = _MAD_TO_SD * np.nanmedian(np.abs(windows[there] - median[there, None]), axis=1)
    return np.abs(values - median), np.maximum(deviation, _resolution(values))


def _resolution(values: np.ndarray) -> float:
    """The smallest step between levels; 0 when nearly every value is a level of its own (not quantised)."""
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if len(levels) < 2 or len(levels) > 0.5 * len(finite):
        return 0.0
    steps = np.diff(levels)
    return float(steps[steps > 1e-9 * np.max(np.abs(levels))].min(initial=levels[-1] - levels[0]))
