"""Butterworth low-pass filtering of plain arrays."""

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import by_stretch, require_positive

FORGOTTEN = 1e-4  # of what was before


def smooth(values: np.ndarray, period: float, cutoff: float, order: int, causal: bool, step: str) -> np.ndarray:
    """Values (n,) through a Butterworth low-pass, stretch by stretch."""
    cutoff = require_positive(cutoff, f"{step}: cutoff")
    nyquist = 0.5 / period
    if cutoff >= nyquist * (1 - 1e-9):
        raise RecordingError(
            f"{step}: cutoff {cutoff:g} Hz is not below half the sampling rate, {nyquist:g} Hz; give a lower one."
        )
    if not isinstance(order, (int, np.integer)) or not 1 <= order <= 10:
        raise RecordingError(f"{step}: order is {order!r}; give a whole number from 1 to 10.")
    sections = np.asarray(butter(order, cutoff / nyquist, output="sos"))
    if causal:
        # starts in the steady state of the first sample, so that there is no jump from 0
        return by_stretch(values, 1, lambda part, _: sosfilt(sections, part, zi=sosfilt_zi(sections) * part[0])[0])
    shortest = 3 * (2 * len(sections) + 1)
    memory = _memory(order, cutoff / nyquist)

    def both_ways(part: np.ndarray, _: slice) -> np.ndarray:
        # beyond both ends the signal goes on, turned about its end, for as long as the filter remembers: it begins
        # there at rest
        return np.asarray(sosfiltfilt(sections, part, padlen=min(max(shortest, memory), len(part) - 1)))

    return by_stretch(values, shortest + 1, both_ways)


def _memory(order: int, cutoff: float) -> int:
    """Samples after which the slowest pole of the filter forgets all but `FORGOTTEN`; `cutoff` as a share of half
    the sampling rate."""
    poles = np.asarray(butter(order, cutoff, output="zpk")[1])
    slowest = float(np.max(np.abs(poles)))
    return int(np.ceil(np.log(FORGOTTEN) / np.log(slowest))) if 0 < slowest < 1 else 0
