"""Outliers by the Hampel identifier."""

import numpy as np

from plantfit.recording.clean.sampling import require_odd, require_positive, signal_of, with_signal
from plantfit.recording.record import Recording

# makes the median absolute deviation estimate the standard deviation of a normal distribution
_MAD_TO_SD = 1.4826


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
    padded = np.pad(values, width // 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, width)
    there = np.isfinite(windows).any(axis=1)
    median, deviation = np.full((2, len(values)), np.nan)
    median[there] = np.nanmedian(windows[there], axis=1)
    deviation[there] = _MAD_TO_SD * np.nanmedian(np.abs(windows[there] - median[there, None]), axis=1)
    out = np.abs(values - median) > limit * np.maximum(deviation, _resolution(values))
    values[out] = np.nan
    sentence = f"{int(out.sum())} outliers of {name!r} dropped (running median of {width} samples, threshold {limit:g})."
    return with_signal(recording, name, values, signal.unit, sentence)


def _resolution(values: np.ndarray) -> float:
    """The smallest step between levels; 0 when nearly every value is a level of its own (not quantised)."""
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if len(levels) < 2 or len(levels) > 0.5 * len(finite):
        return 0.0
    steps = np.diff(levels)
    return float(steps[steps > 1e-9 * np.max(np.abs(levels))].min(initial=levels[-1] - levels[0]))
