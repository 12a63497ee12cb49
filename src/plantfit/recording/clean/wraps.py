"""Signals that begin anew at the end of their range: a counter of 16 bits, an angle of 0 to 360 degrees."""

from collections.abc import Iterator

import numpy as np

from plantfit.errors import PlantfitError, RecordingError
from plantfit.recording.clean.sampling import signal_of, with_signal
from plantfit.recording.record import Recording
from plantfit.units import compatible, factor_offset, in_unit

COUNTERS = tuple(float(2**bits) for bits in (8, 10, 12, 14, 16))
TURN = 2 * np.pi  # rad
LARGE = 0.6  # of the range, from which on a step may be a wrap
MOVES = 0.25  # of the range: the most that a signal moves from sample to sample elsewhere
AGREE = 8.0  # robust deviations of second differences, by which a step may differ from its neighbours
BETWEEN = 0.05  # of the samples, which must be away from both ends: a switch has two levels alone


def unwrap(recording: Recording, name: str, period: float | str) -> Recording:
    """Let a signal run on where it began anew: an angle of 0 to 360 degrees, a counter of 16 bits.

    `period` is the length of its range, a number in the unit of the signal or a text with a unit ("360 deg"). Each step
    of more than half of it is taken as one the short way round; missing samples are passed over. Raises RecordingError
    for a period that is not above 0, or whose unit does not fit.
    """
    signal = signal_of(recording, name)
    length = _length(name, period, signal.unit)
    values, known = signal.values.copy(), np.isfinite(signal.values)
    turns = -np.rint(np.diff(values[known]) / length)
    values[known] += length * np.concatenate([[0.0], np.cumsum(turns)])
    count = int(np.count_nonzero(turns))
    return with_signal(
        recording, name, values, signal.unit, f"{name!r} runs on where it began anew: {count} times, by {length:g}."
    )


def _length(name: str, period: float | str, unit: str | None) -> float:
    place = f"unwrap({name!r}), period"
    if isinstance(period, str) and unit is None:
        raise RecordingError(f"{place}: {name!r} has no unit that {period!r} could be converted to; give a number.")
    try:
        length = in_unit(place, period, unit)
    except PlantfitError as error:
        raise RecordingError(str(error)) from None
    if isinstance(period, bool) or not 0 < length < np.inf:
        raise RecordingError(f"{place} is {period!r}; give a length above 0, as 360 or '360 deg'.")
    return float(length)


def wraps_of(values: np.ndarray, unit: str | None) -> tuple[float, np.ndarray] | None:
    """The period by which finite values (n,) wrap, in their unit, and the samples before which they do; None where
    they do not.

    Few steps are nearly as long as the range, a period that angles or counters have fits it, and less that period they
    go on as their neighbours do.
    """
    span = float(np.ptp(values))
    steps = np.diff(values)
    if len(values) < 20 or span == 0:
        return None
    large = np.abs(steps) > LARGE * span
    at = np.flatnonzero(large)
    if not len(at) or len(at) > len(steps) / 5 or np.any(np.abs(steps[~large]) > MOVES * span):
        return None
    inner = np.abs(values - values.min() - 0.5 * span) < (0.5 - BETWEEN) * span
    if np.mean(inner) < BETWEEN:
        return None
    fastest = float(np.max(np.abs(steps[~large])))
    for period in _periods(unit):
        if not -1e-9 * span <= period - span <= 2 * fastest + 1e-3 * period:
            continue
        on = np.where(large, steps - period * np.sign(steps), steps)
        second = np.abs(np.diff(on))
        usual = 1.4826 * float(np.median(second)) + 2e-3 * period
        before, after = on[np.maximum(at - 1, 0)], on[np.minimum(at + 1, len(on) - 1)]
        if np.all(np.minimum(np.abs(on[at] - before), np.abs(on[at] - after)) <= AGREE * usual):
            return period, at + 1
    return None


def _periods(unit: str | None) -> Iterator[float]:
    if unit not in (None, "", "1") and compatible(unit, "rad"):
        yield TURN * factor_offset("rad", unit)[0]
    elif unit in (None, "", "1"):
        yield from (360.0, TURN, *COUNTERS)
