"""Even time grids, with an anti-alias filter when the new one is coarser."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.butterworth import smooth
from plantfit.recording.clean.sampling import period_of, require_positive, signal_of
from plantfit.recording.record import Recording, Signal

Method = Literal["linear", "previous"]
_ORDER = 4
_SHARE_OF_NYQUIST = 0.8
_MOST_SAMPLES = 50_000_000


def resample(
    recording: Recording, period: float, method: Method | Mapping[str, Method] = "linear", longest: float | None = None
) -> Recording:
    """Samples every `period` seconds from the first time on.

    `method` for all signals, or by signal name ("linear" for those left out): "previous" keeps held
    inputs held. Linear signals are low-pass filtered (zero-phase, 0.8 of the new half rate) when
    the new period is longer than the old. Where two good samples are farther apart than `longest`
    seconds (default: five of the longer period) the result is missing.
    Raises RecordingError for unknown signals and methods.
    """
    period = require_positive(period, "resample: period")
    methods = _methods(recording, method)
    old = period_of(recording)
    limit = 5 * max(old, period) if longest is None else require_positive_or_inf(longest)
    count = int(np.floor((recording.t[-1] - recording.t[0]) / period * (1 + 1e-12) + 1e-6)) + 1
    if count > _MOST_SAMPLES:
        raise RecordingError(f"resample: a period of {period:g} s would make {count} samples; give a longer period.")
    t = recording.t[0] + np.arange(count) * period
    signals, missing = {}, 0
    for name, signal in recording.signals.items():
        source_t, values = recording.t, signal.values
        if methods[name] == "linear" and period > 1.05 * old:
            source_t, values = _anti_aliased(source_t, values, old, period, limit)
        signals[name] = Signal(_at(t, source_t, values, methods[name], limit), signal.unit)
        missing += int(np.isnan(signals[name].values).sum())
    held = [name for name, how in methods.items() if how == "previous"]
    sentence = (
        f"Resampled from about {old:g} s to {period:g} s: {len(recording)} samples became {count}"
        f"{f', holding {held}' if held else ''}"
        f"{', with an anti-alias filter' if period > 1.05 * old else ''}; {missing} values are missing."
    )
    return Recording(t, signals, recording.name, (*recording.log, sentence))


def decimate(recording: Recording, factor: int, method: Method | Mapping[str, Method] = "linear") -> Recording:
    """Every `factor`-th sample on an even grid, after the anti-alias filter; `method` as for `resample`."""
    if not isinstance(factor, (int, np.integer)) or isinstance(factor, bool) or factor < 2:
        raise RecordingError(f"decimate: factor is {factor!r}; give a whole number of at least 2.")
    return resample(recording, int(factor) * period_of(recording), method)


def require_positive_or_inf(longest: float) -> float:
    """`longest` as a float, where infinity allows every gap."""
    return float(longest) if longest == np.inf else require_positive(longest, "resample: longest")


def _methods(recording: Recording, method: Method | Mapping[str, Method]) -> dict[str, str]:
    given = dict.fromkeys(recording.signals, method) if isinstance(method, str) else dict(method)
    for name, how in given.items():
        signal_of(recording, name)
        if how not in ("linear", "previous"):
            raise RecordingError(f"resample: method for {name!r} is {how!r}; use 'linear' or 'previous'.")
    return {name: str(given.get(name, "linear")) for name in recording.signals}


def _anti_aliased(
    t: np.ndarray, values: np.ndarray, old: float, new: float, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    fine = t[0] + np.arange(int(np.floor((t[-1] - t[0]) / old + 1e-6)) + 1) * old
    even = _at(fine, t, values, "linear", limit)
    smoothed = smooth(even, old, _SHARE_OF_NYQUIST * 0.5 / new, _ORDER, False, "resample")
    # stretches too short for the filter keep their values
    return fine, np.where(np.isfinite(smoothed), smoothed, even)


def _at(times: np.ndarray, t: np.ndarray, values: np.ndarray, method: str, limit: float) -> np.ndarray:
    """Values at `times`; NaN where the neighbours are missing or more than `limit` apart."""
    slack = 1e-6 * float(np.min(np.diff(t))) if len(t) > 1 else 0.0
    left = np.clip(np.searchsorted(t, times + slack, side="right") - 1, 0, len(t) - 1)
    right = np.minimum(left + 1, len(t) - 1)
    on_sample = np.abs(times - t[left]) <= slack
    far = (t[right] - t[left] > limit) & ~on_sample
    if method == "previous":
        return np.where(far | (times > t[-1] + limit), np.nan, values[left])
    span = np.where(right > left, t[right] - t[left], 1.0)
    share = np.clip((times - t[left]) / span, 0.0, 1.0)
    between = values[left] + share * (values[right] - values[left])
    return np.where(on_sample, values[left], np.where(far, np.nan, between))
