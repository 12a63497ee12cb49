"""Duty of a pulse-width modulated bridge: with the sign of its direction, and as the mean voltage that the motor
sees."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import require_positive, signal_of, with_new
from plantfit.recording.record import Recording


def signed(
    recording: Recording,
    signal: str,
    direction: str,
    name: str,
    forward: float | None = None,
    backward: float | None = None,
) -> Recording:
    """Add `signal` with the sign that `direction` gives it as `name`, in its unit: as it is where the direction is
    `forward` (the higher of its two levels if left out), negative where it is `backward`, the other level.

    Where both are given a record may hold one of them alone, as one of a plant that never turned back. For boards that
    command a duty and, by another pin, the direction of the bridge. Raises RecordingError where the signal has a sign
    already, or where the direction has not two levels or no value.
    """
    source, way = signal_of(recording, signal), signal_of(recording, direction).values
    step = f"signed({signal!r})"
    if np.any(source.values < 0):
        at = int(np.flatnonzero(source.values < 0)[0])
        raise RecordingError(
            f"{step}: {signal!r} is {source.values[at]:g} at {recording.t[at]:g} s, so it has a sign already; leave "
            "the step out."
        )
    levels = np.unique(way)
    known = bool(np.isfinite(levels).all())
    ahead, behind = _ways(levels, forward, backward) if known else (None, None)
    if ahead is None or behind is None:
        seen = f"{len(levels)} level{'s' * (len(levels) != 1)}" if known else "missing values"
        treated = "name another signal, or correct it"
        if known and len(levels) == 1:
            treated = "if the plant only ran one way here, write both levels, as in forward = 1, backward = 0"
        raise RecordingError(
            f"{step}: {direction!r} has {seen}, where a direction has two levels throughout; {treated}."
        )
    if ahead == behind:
        raise RecordingError(f"{step}: forward and backward are both {ahead:g}; give the two levels of {direction!r}.")
    stray = [level for level in levels if level not in (ahead, behind)]
    if stray:
        held = " or ".join(f"{level:g}" for level in levels) if len(levels) < 3 else f"also {stray[0]:g}"
        said = f"forward is {ahead:g}" + (f" and backward {behind:g}" if backward is not None else "")
        raise RecordingError(f"{step}: {said}, but {direction!r} is {held}.")
    sentence = f"{name!r} is {signal!r}, positive where {direction!r} is {ahead:g} and negative elsewhere."
    return with_new(recording, name, np.where(way == ahead, 1.0, -1.0) * source.values, source.unit, sentence, step)


def _ways(levels: np.ndarray, forward: float | None, backward: float | None) -> tuple[float | None, float | None]:
    """The levels forward and backward as they are given, or as the levels of a record say; None where these do not."""
    if forward is not None and backward is not None:
        return float(forward), float(backward)
    if len(levels) != 2:
        return None, None
    low, high = map(float, levels)
    if forward is None and backward is None:
        return high, low
    if forward is not None:
        return float(forward), high if forward == low else low
    return low if backward == high else high, float(backward or 0.0)


def duty_to_voltage(
    recording: Recording,
    signal: str,
    name: str,
    supply: float | str,
    full_scale: float,
    bits: int | None = 8,
    efficiency: float = 1.0,
) -> Recording:
    """Add the mean voltage of an H-bridge as `name` (V): efficiency * supply * n / (2^bits - 1), n = round((2^bits - 1)
    duty / full_scale).

    `full_scale` is the duty that means always on: 255 for an 8-bit register, 1 for a share, 100 for percent; negative
    duty drives backwards. `supply` is a number (V) or a signal with the battery's voltage; `bits` None leaves the duty
    unrounded. Raises RecordingError for duty beyond full scale.
    """
    source = signal_of(recording, signal)
    step = f"duty_to_voltage({signal!r})"
    top = require_positive(full_scale, f"{step}: full_scale")
    if bits is not None and (isinstance(bits, bool) or not isinstance(bits, int) or not 1 <= bits <= 32):
        raise RecordingError(f"{step}: bits is {bits!r}; give a whole number from 1 to 32, or none for no rounding.")
    if not 0 < efficiency <= 1:
        raise RecordingError(f"{step}: efficiency is {efficiency!r}; give a share above 0 and at most 1, such as 0.98.")
    share = source.values / top
    beyond = np.flatnonzero(np.abs(share) > 1 + 1e-9)
    if len(beyond):
        raise RecordingError(
            f"{step}: the duty is {source.values[beyond[0]]:g} at {recording.t[beyond[0]]:g} "
            f"s, beyond full_scale = {top:g}; give the value that means always on."
        )
    if bits is not None:
        share = np.round(share * (2**bits - 1)) / (2**bits - 1)
    volts, about = _supply(recording, supply, step)
    rounding = f"rounded to {bits} bits, " if bits is not None else ""
    sentence = (
        f"{name!r} is the voltage of duty {signal!r} ({rounding}{about}, efficiency {efficiency:g}), "
        f"{len(recording)} samples."
    )
    return with_new(recording, name, efficiency * volts * share, "V", sentence, step)


def _supply(recording: Recording, supply: float | str, step: str) -> tuple[float | np.ndarray, str]:
    if isinstance(supply, str):
        signal = signal_of(recording, supply)
        if signal.unit not in (None, "V"):
            raise RecordingError(f"{step}: the supply {supply!r} is in {signal.unit!r}; convert_units to V first.")
        return signal.values, f"supply {supply!r}"
    return require_positive(supply, f"{step}: supply"), f"supply {supply:g} V"
