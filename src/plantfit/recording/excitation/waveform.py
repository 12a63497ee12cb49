"""From values at a rate to a recording, and the checks that all waveforms share."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal

MOST_SAMPLES = 20_000_000


def waveform(values: np.ndarray, rate: float, signal: str, unit: str | None, kind: str, sentence: str) -> Recording:
    """Values (n,), each held for 1/`rate` seconds, as a recording named `kind`."""
    t = np.arange(len(values)) / rate
    lowest, highest = float(np.min(values)), float(np.max(values))
    ends = f"from {lowest:g} to {highest:g} {unit or ''}".rstrip()
    told = f"{sentence} {len(values)} samples at {rate:g} Hz ({len(values) / rate:g} s), {ends}"
    return Recording(t, {signal: Signal(values, unit)}, kind, (f"{told}.",))


def positive(kind: str, **given: float) -> None:
    """Raise RecordingError for the first value that is not a finite number above 0."""
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise RecordingError(f"{kind}: {name} is {value!r}; give a number above 0.")


def samples(kind: str, rate: float, duration: float) -> int:
    """How many samples of 1/`rate` seconds fill `duration` seconds; at least 2."""
    positive(kind, rate=rate, duration=duration)
    n = round(rate * duration)
    if not 2 <= n <= MOST_SAMPLES:
        raise RecordingError(
            f"{kind}: {duration:g} s at {rate:g} Hz are {n} samples; choose from 2 to {MOST_SAMPLES:,}."
        )
    return n


def below_nyquist(kind: str, rate: float, **frequencies: float) -> None:
    """Raise RecordingError for a frequency (Hz) that samples at `rate` cannot carry."""
    for name, value in frequencies.items():
        if not 0 < value <= rate / 2:
            raise RecordingError(
                f"{kind}: {name} is {value:g} Hz, but samples at {rate:g} Hz "
                f"carry up to {rate / 2:g} Hz; lower it or raise the rate."
            )
