"""Time derivatives of measured signals."""

from typing import Literal, get_args

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.signal import savgol_filter

from plantfit.errors import RecordingError
from plantfit.recording.clean.butterworth import smooth
from plantfit.recording.clean.cutoff import CutoffRule, resolve_cutoff
from plantfit.recording.clean.sampling import (
    by_stretch,
    lost,
    period_of,
    require_odd,
    signal_of,
    uniform_period,
    with_signal,
)
from plantfit.recording.record import Recording
from plantfit.recording.signals.smoother import kalman_smoother
from plantfit.units import per_second

DerivativeMethod = Literal["savgol", "central", "forward", "butterworth", "spline", "kalman"]


def differentiate(
    recording: Recording,
    signal: str,
    name: str | None = None,
    method: DerivativeMethod = "savgol",
    *,
    derivative: int = 1,
    window: int = 11,
    order: int = 3,
    cutoff: float | CutoffRule | None = None,
    noise: float | None = None,
    smoothing: float | None = None,
) -> Recording:
    """Add the first or second time `derivative` of a signal as `name` (default: the signal's name and "d" or "dd").

    "savgol": polynomial of `order` over `window` samples (Savitzky and Golay, Anal. Chem. 36, 1964).
    "central": central differences. "butterworth": central differences after a zero-phase low-pass of `order` at
    `cutoff`. "forward": the mean rate until the next sample, the last one repeated. Held between samples, its integral
    is the signal again at every sample: for the counts of an encoder that drive a model. "kalman": Rauch-Tung-Striebel
    smoothing of `order`-fold integrated white noise, by default at the most likely cut-off. "spline": cubic smoothing
    spline, its penalty `smoothing` (for time in samples) chosen by cross-validation when left out. `cutoff` is in Hz or
    a rule of `cutoff_frequency` with its `noise`. "central", "forward", "kalman" and "spline" take uneven steps. The
    unit gains "/s" once or twice. Raises RecordingError for settings that do not fit the method.
    """
    source = signal_of(recording, signal)
    step = f"differentiate({signal!r})"
    if derivative not in (1, 2):
        raise RecordingError(f"{step}: derivative is {derivative!r}; give 1 or 2.")
    new = signal + "d" * derivative if name is None else name
    if new in recording.signals:
        raise RecordingError(f"{step}: recording {recording.name!r} already has a signal {new!r}; give another name=.")
    if method not in get_args(DerivativeMethod):
        raise RecordingError(
            f"{step}: method is {method!r}; use one of {', '.join(map(repr, get_args(DerivativeMethod)))}."
        )
    if method == "butterworth" and cutoff is None:
        raise RecordingError(f"{step}: method 'butterworth' needs cutoff= in Hz, or a rule such as 'residual'.")
    why = ""
    if method in ("butterworth", "kalman"):
        cutoff, why = resolve_cutoff(recording, signal, cutoff or "likelihood", order, noise)
        values = _low_passed(recording, source.values, method, derivative, cutoff, order, step)
    else:
        values = _local(recording, source.values, method, derivative, window, order, smoothing, step)
    if not np.isfinite(values).any():
        raise RecordingError(f"{step}: {_too_short(source.values)}")
    unit = source.unit
    if unit is not None:
        unit = per_second(unit) if derivative == 1 else per_second(per_second(unit))
    which, how = (
        ("", "second ")[derivative - 1],
        f"{method}, {cutoff:.3g} Hz" if method in ("butterworth", "kalman") else method,
    )
    sentence = (
        f"{new!r} is the {which}derivative of {signal!r} ({how}), {int(np.isfinite(values).sum())} "
        f"samples{lost(source.values, values)}."
    )
    return with_signal(recording, new, values, unit, sentence + why)


def _too_short(values: np.ndarray) -> str:
    """Why no derivative came of values (n,), and what helps."""
    if np.isfinite(values).all():
        return f"{len(values)} samples are too few for this method; use a longer recording, or a smaller window."
    if not np.isfinite(values).any():
        return "all samples are missing; choose another signal."
    return (
        "every stretch without missing samples is too short; fill the gaps first (fill_gaps), or use a smaller window."
    )


def _low_passed(
    recording: Recording, values: np.ndarray, method: str, derivative: int, cutoff: float, order: int, step: str
) -> np.ndarray:
    t = recording.t
    if method == "butterworth":
        return _central(smooth(values, uniform_period(recording, step), cutoff, order, False, step), t, derivative)
    if not isinstance(order, (int, np.integer)) or not derivative < order <= 4:
        raise RecordingError(f"{step}: order is {order!r}; give a whole number from {derivative + 1} to 4.")
    return by_stretch(
        values,
        2 * order + 1,
        lambda part, place: kalman_smoother(t[place], part, cutoff, order=order).states[:, derivative],
    )


def _local(
    recording: Recording,
    values: np.ndarray,
    method: str,
    derivative: int,
    window: int,
    order: int,
    smoothing: float | None,
    step: str,
) -> np.ndarray:
    t = recording.t
    if method == "central":
        return _central(values, t, derivative)
    if method == "forward":
        if derivative != 1:
            raise RecordingError(
                f"{step}: method 'forward' gives the first derivative only; use 'central' for the second."
            )
        return by_stretch(
            values, 2, lambda part, place: (rate := np.diff(part) / np.diff(t[place]))[[*range(len(rate)), -1]]
        )
    if method == "savgol":
        period = uniform_period(recording, step)
        width = require_odd(window, step, 3)
        if not isinstance(order, (int, np.integer)) or not derivative <= order < width:
            raise RecordingError(
                f"{step}: order is {order!r}; give a whole number from {derivative} to below the window of {width}."
            )
        return by_stretch(
            values, width, lambda part, _: np.asarray(savgol_filter(part, width, order, deriv=derivative, delta=period))
        )
    if smoothing is not None and not smoothing >= 0:
        raise RecordingError(f"{step}: smoothing is {smoothing!r}; give a number of at least 0.")
    period = period_of(recording)

    def spline(part: np.ndarray, place: slice) -> np.ndarray:
        x = (t[place] - t[place][0]) / period
        return make_smoothing_spline(x, part, lam=smoothing).derivative(derivative)(x) / period**derivative

    return by_stretch(values, 5, spline)


def _central(values: np.ndarray, t: np.ndarray, derivative: int) -> np.ndarray:
    for _ in range(derivative):
        values = by_stretch(values, 3, lambda part, place: np.gradient(part, t[place], edge_order=2))
    return values
