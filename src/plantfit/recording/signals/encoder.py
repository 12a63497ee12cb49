"""Incremental encoders: angle and speed from counts, speed from the time between two pulses.

Source: angle eta = 2 pi G N / Nrev, speed by its difference over the sample, and w = G (2 pi / pulses) / Tp ("The Use
of a Statistical Filter and Metaheuristics to Model and Control the DC Motor of the Mobile Robot Used on NXP Cup", 2018,
eq. 4, 5, 16).
"""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import require_positive, signal_of, with_new
from plantfit.recording.record import Recording
from plantfit.units import factor_offset


def counts_to_angle(
    recording: Recording, signal: str, name: str, counts: float, ratio: float = 1.0, wrap_bits: int | None = None
) -> Recording:
    """Add the angle of a shaft as `name` (rad): 2 pi ratio N / counts, `counts` a revolution of the encoder.

    `ratio` is the turns of the shaft for one of the encoder. `wrap_bits` is the width of a counter that overflows.
    """
    step = f"counts_to_angle({signal!r})"
    angle = _angle(recording, signal, counts, ratio, wrap_bits, step)
    sentence = (
        f"{name!r} is the angle of {signal!r} ({counts:g} counts a revolution, ratio {ratio:g}), "
        f"{_known(angle)} samples."
    )
    return with_new(recording, name, angle, "rad", sentence, step)


def counts_to_speed(
    recording: Recording, signal: str, name: str, counts: float, ratio: float = 1.0, wrap_bits: int | None = None
) -> Recording:
    """Add the speed of a shaft as `name` (rad/s): the change of its angle since the sample before, over the time
    between them.

    It is the mean speed over that time, so it lags by half of it, in steps of 2 pi ratio / counts / period. The first
    sample and those beside a missing count are missing. Other arguments as in `counts_to_angle`.
    """
    step = f"counts_to_speed({signal!r})"
    angle = _angle(recording, signal, counts, ratio, wrap_bits, step)
    speed = np.concatenate([[np.nan], np.diff(angle) / np.diff(recording.t)])
    sentence = (
        f"{name!r} is the speed of {signal!r} ({counts:g} counts a revolution, ratio {ratio:g}), "
        f"{_known(speed)} samples."
    )
    return with_new(recording, name, speed, "rad/s", sentence, step)


def period_to_speed(
    recording: Recording,
    signal: str,
    name: str,
    pulses: float,
    ratio: float = 1.0,
    timeout: float | None = None,
    *,
    slot_error: float = 0.0,
    tick: float = 0.0,
    counts: str | None = None,
    lag: str | None = None,
    slot: str | None = None,
) -> Recording:
    """Add the speed of a shaft as `name` (rad/s): ratio (2 pi / pulses) / Tp from the period Tp of the encoder's
    pulses.

    `pulses` a revolution of the encoder; `timeout` (s): such a period and longer ones mean rest, 0 rad/s. The sign is
    that of the period, for encoders that tell the direction. What makes the mean of 1/Tp high is taken off: of
    `slot_error`, the rms error of an edge's place as a share of a slot, 2 squares, and a third where samples skip
    pulses; of `tick`, the timer's step (s), a sixth of the square of tick/Tp.

    `counts` names the counted pulses: where they have not changed, Tp is an old one and the speed becomes missing. With
    it two new signals may be named. `lag` (s), for `backdate`: the speed is the mean over a pulse, whose middle was on
    average (Tp + the smaller of Tp and the sampling period) / 2 before the sample. `slot`: which of the disc's slots
    was timed, for `shared_errors`, because the error of a slot comes back with every turn. Raises RecordingError for a
    period of 0 and an unknown unit of time.
    """
    source = signal_of(recording, signal)
    step = f"period_to_speed({signal!r})"
    width = require_positive(ratio, f"{step}: ratio") * 2 * np.pi / require_positive(pulses, f"{step}: pulses")
    if source.unit is None:
        raise RecordingError(
            f"{step}: the period has no unit; state it in units where the recording is read, such as 's' or 'us'."
        )
    if not 0 <= slot_error < 0.3:
        raise RecordingError(
            f"{step}: slot_error is {slot_error!r}; give a share of a slot from 0 to 0.3, such as 0.02."
        )
    if not 0 <= tick < np.inf:
        raise RecordingError(f"{step}: tick is {tick!r}; give the step of the timer in seconds, such as 1e-6.")
    period = source.values * factor_offset(source.unit, "s")[0]
    if np.any(period == 0):
        raise RecordingError(
            f"{step}: the period is 0 at {recording.t[int(np.argmax(period == 0))]:g} s; drop that sample first."
        )
    sampling = np.diff(recording.t, prepend=recording.t[0])
    high = slot_error**2 * np.where(np.abs(period) < sampling, 3, 2) + (tick / period) ** 2 / 6
    speed = width / period / (1 + high)
    if counts is None and (lag is not None or slot is not None):
        raise RecordingError(f"{step}: lag and slot need the counted pulses; give counts, the signal that holds them.")
    counted = None if counts is None else signal_of(recording, counts).values
    if counted is not None:
        speed[np.diff(counted, prepend=counted[:1]) == 0] = np.nan
    if timeout is not None:
        speed[np.abs(period) >= require_positive(timeout, f"{step}: timeout")] = 0.0
    errors = (f", slot error {slot_error:g}" if slot_error else "") + (f", timer of {tick:g} s" if tick else "")
    said = f"{pulses:g} pulses, ratio {ratio:g}{errors}"
    sentence = f"{name!r} is the speed of the pulse period {signal!r} ({said}), {_known(speed)} samples."
    recording = with_new(recording, name, speed, "rad/s", sentence, step)
    if lag is not None:
        late = 0.5 * (np.abs(period) + np.minimum(np.abs(period), sampling))
        about = (
            f"{lag!r} is how long before its sample {name!r} was the "
            f"mean speed, {np.nanmedian(late):.3g} s at the median."
        )
        recording = with_new(recording, lag, late, "s", about, step)
    if slot is not None and counted is not None:
        number = np.where(np.isfinite(speed), np.mod(counted - np.sign(period), pulses), np.nan)
        recording = with_new(
            recording, slot, number, None, f"{slot!r} is the slot of the disc that {signal!r} timed.", step
        )
    return recording


def unwrapped(values: np.ndarray, wrap_bits: int | None, step: str) -> np.ndarray:
    """Counts (n,) of a counter of `wrap_bits` that overflows, as one that does not; missing samples stay missing."""
    if wrap_bits is None:
        return values
    if isinstance(wrap_bits, bool) or not isinstance(wrap_bits, int) or not 4 <= wrap_bits <= 64:
        raise RecordingError(
            f"{step}: wrap_bits is {wrap_bits!r}; give the counter's width, a whole number from 4 to 64, or none."
        )
    there = np.isfinite(values)
    result = values.copy()
    result[there] = np.unwrap(values[there], period=2.0**wrap_bits)
    return result


def _angle(
    recording: Recording, signal: str, counts: float, ratio: float, wrap_bits: int | None, step: str
) -> np.ndarray:
    values = unwrapped(signal_of(recording, signal).values, wrap_bits, step)
    return 2 * np.pi * require_positive(ratio, f"{step}: ratio") / require_positive(counts, f"{step}: counts") * values


def _known(values: np.ndarray) -> int:
    return int(np.isfinite(values).sum())
