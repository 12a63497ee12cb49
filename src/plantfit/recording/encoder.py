"""Incremental encoders: angle and speed from counts, speed from the time between two pulses.

Source: angle eta = 2 pi G N / Nrev, speed by its difference over the sample, and w = G (2 pi / pulses) / Tp ("The Use of a
Statistical Filter and Metaheuristics to Model and Control the DC Motor of the Mobile Robot Used on NXP Cup", 2018, eq. 4, 5, 16).
"""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording
from plantfit.recording.sampling import require_positive, signal_of, with_new
from plantfit.units import factor_offset


def counts_to_angle(
    recording: Recording, signal: str, name: str, counts: float, ratio: float = 1.0, wrap_bits: int | None = None
) -> Recording:
    """Add the angle of a shaft as `name` (rad): 2 pi ratio N / counts, `counts` a revolution of the encoder.

    `ratio` is the turns of the shaft for one of the encoder. `wrap_bits` is the width of a counter that overflows.
    """
    step = f"counts_to_angle({signal!r})"
    angle = _angle(recording, signal, counts, ratio, wrap_bits, step)
    sentence = f"{name!r} is the angle of {signal!r} ({counts:g} counts a revolution, ratio {ratio:g}), {_known(angle)} samples."
    return with_new(recording, name, angle, "rad", sentence, step)


def counts_to_speed(
    recording: Recording, signal: str, name: str, counts: float, ratio: float = 1.0, wrap_bits: int | None = None
) -> Recording:
    """Add the speed of a shaft as `name` (rad/s): the change of its angle since the sample before, over the time between them.

    It is the mean speed over that time, so it lags by half of it, in steps of 2 pi ratio / counts / period. The first sample
    and those beside a missing count are missing. Other arguments as in `counts_to_angle`.
    """
    step = f"counts_to_speed({signal!r})"
    angle = _angle(recording, signal, counts, ratio, wrap_bits, step)
    speed = np.concatenate([[np.nan], np.diff(angle) / np.diff(recording.t)])
    sentence = f"{name!r} is the speed of {signal!r} ({counts:g} counts a revolution, ratio {ratio:g}), {_known(speed)} samples."
    return with_new(recording, name, speed, "rad/s", sentence, step)


def period_to_speed(
    recording: Recording, signal: str, name: str, pulses: float, ratio: float = 1.0, timeout: float | None = None
) -> Recording:
    """Add the speed of a shaft as `name` (rad/s): ratio (2 pi / pulses) / Tp from the period Tp of the encoder's pulses.

    `pulses` a revolution of the encoder; `timeout` (s): such a period and longer ones mean rest, 0 rad/s. The sign is that of
    the period, for encoders that tell the direction. Raises RecordingError for a period of 0 and an unknown unit of time.
    """
    source = signal_of(recording, signal)
    step = f"period_to_speed({signal!r})"
    slot = require_positive(ratio, f"{step}: ratio") * 2 * np.pi / require_positive(pulses, f"{step}: pulses")
    if source.unit is None:
        raise RecordingError(f"{step}: the period has no unit; give units= when reading, such as 's' or 'us'.")
    period = source.values * factor_offset(source.unit, "s")[0]
    if np.any(period == 0):
        raise RecordingError(f"{step}: the period is 0 at {recording.t[int(np.argmax(period == 0))]:g} s; drop that sample first.")
    speed = slot / period
    if timeout is not None:
        speed[np.abs(period) >= require_positive(timeout, f"{step}: timeout")] = 0.0
    sentence = f"{name!r} is the speed of the pulse period {signal!r} ({pulses:g} pulses, ratio {ratio:g}), {_known(speed)} samples."
    return with_new(recording, name, speed, "rad/s", sentence, step)


def unwrapped(values: np.ndarray, wrap_bits: int | None, step: str) -> np.ndarray:
    """Counts (n,) of a counter of `wrap_bits` that overflows, as one that does not; missing samples stay missing."""
    if wrap_bits is None:
        return values
    if isinstance(wrap_bits, bool) or not isinstance(wrap_bits, int) or not 4 <= wrap_bits <= 64:
        raise RecordingError(f"{step}: wrap_bits is {wrap_bits!r}; give the counter's width, a whole number from 4 to 64, or none.")
    there = np.isfinite(values)
    result = values.copy()
    result[there] = np.unwrap(values[there], period=2.0**wrap_bits)
    return result


def _angle(recording: Recording, signal: str, counts: float, ratio: float, wrap_bits: int | None, step: str) -> np.ndarray:
    values = unwrapped(signal_of(recording, signal).values, wrap_bits, step)
    return 2 * np.pi * require_positive(ratio, f"{step}: ratio") / require_positive(counts, f"{step}: counts") * values


def _known(values: np.ndarray) -> int:
    return int(np.isfinite(values).sum())
