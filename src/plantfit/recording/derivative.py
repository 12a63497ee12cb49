"""Time derivatives of measured signals."""

from typing import Literal

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.signal import savgol_filter

from plantfit.errors import RecordingError
from plantfit.recording.filters import smooth
from plantfit.recording.record import Recording
from plantfit.recording.sampling import by_stretch, lost, require_odd, signal_of, uniform_period, with_signal
from plantfit.units import per_second

DerivativeMethod = Literal["savgol", "central", "butterworth", "spline"]


def differentiate(
    recording: Recording,
    signal: str,
    name: str | None = None,
    method: DerivativeMethod = "savgol",
    *,
    window: int = 11,
    order: int = 3,
    cutoff: float | None = None,
    smoothing: float | None = None,
) -> Recording:
    """Add the time derivative of a signal as `name` (default: the signal's name and "d").

    "savgol": polynomial of `order` over `window` samples (Savitzky and Golay, Anal. Chem. 36, 1964).
    "central": central differences, also for uneven steps. "butterworth": central differences after
    a zero-phase low-pass of `order` at `cutoff` Hz. "spline": cubic smoothing spline, its penalty
    `smoothing` (for time in samples) chosen by cross-validation when left out.
    The unit gains "/s". Raises RecordingError for settings that do not fit the method.
    """
    source = signal_of(recording, signal)
    step = f"differentiate({signal!r})"
    new = f"{signal}d" if name is None else name
    if new in recording.signals:
        raise RecordingError(f"{step}: recording {recording.name!r} already has a signal {new!r}; give another name=.")
    if method not in ("savgol", "central", "butterworth", "spline"):
        raise RecordingError(f"{step}: method is {method!r}; use 'savgol', 'central', 'butterworth' or 'spline'.")
    if method == "butterworth" and cutoff is None:
        raise RecordingError(f"{step}: method 'butterworth' needs cutoff= in Hz.")
    values = _derivative(recording, source.values, method, window, order, cutoff, smoothing, step)
    if not np.isfinite(values).any():
        raise RecordingError(f"{step}: no stretch without missing samples is long enough; call fill_gaps first or use a smaller window.")
    unit = None if source.unit is None else per_second(source.unit)
    sentence = f"{new!r} is the derivative of {signal!r} ({method}), {int(np.isfinite(values).sum())} samples{lost(source.values, values)}."
    return with_signal(recording, new, values, unit, sentence)


def _derivative(
    recording: Recording, values: np.ndarray, method: str, window: int, order: int, cutoff: float | None, smoothing: float | None, step: str
) -> np.ndarray:
    t = recording.t
    if method == "central":
        return _central(values, t)
    period = uniform_period(recording, step)
    if method == "butterworth":
        return _central(smooth(values, period, cutoff or 0.0, order, False, step), t)
    if method == "savgol":
        width = require_odd(window, step, 3)
        if not isinstance(order, (int, np.integer)) or not 1 <= order < width:
            raise RecordingError(f"{step}: order is {order!r}; give a whole number from 1 to below the window of {width}.")
        return by_stretch(values, width, lambda part, _: np.asarray(savgol_filter(part, width, order, deriv=1, delta=period)))
    if smoothing is not None and not smoothing >= 0:
        raise RecordingError(f"{step}: smoothing is {smoothing!r}; give a number of at least 0.")
    return by_stretch(values, 5, lambda part, place: _spline(part, (t[place] - t[place][0]) / period, smoothing) / period)


def _central(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    return by_stretch(values, 3, lambda part, place: np.gradient(part, t[place], edge_order=2))


def _spline(values: np.ndarray, t: np.ndarray, smoothing: float | None) -> np.ndarray:
    return make_smoothing_spline(t, values, lam=smoothing).derivative()(t)
