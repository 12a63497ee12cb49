"""Offsets, trends, gains and units."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from plantfit.errors import RecordingError, UnitError
from plantfit.recording.clean.sampling import signal_of, with_signal
from plantfit.recording.record import Recording
from plantfit.units import compatible, difference_of, equal, factor_offset, is_point, of_another_kind, parse


def detrend(recording: Recording, name: str, kind: Literal["mean", "linear"] = "mean") -> Recording:
    """Take away the mean, or the straight line of least squares, over the samples that are there."""
    signal = signal_of(recording, name)
    if kind not in ("mean", "linear"):
        raise RecordingError(f"detrend({name!r}): kind is {kind!r}; use 'mean' or 'linear'.")
    values, t = signal.values, recording.t
    good = np.isfinite(values)
    if good.sum() < (1 if kind == "mean" else 2):
        raise RecordingError(f"detrend({name!r}): too few samples are there; choose another signal.")
    middle = float(t[good].mean())
    level = float(values[good].mean())
    slope = float(np.polyfit(t[good] - middle, values[good], 1)[0]) if kind == "linear" else 0.0
    about = f"mean {level:g}" if kind == "mean" else f"line {level:g} {slope:+g} (t - {middle:g} s)"
    sentence = f"The {about} was subtracted from all {int(good.sum())} samples of {name!r}."
    return with_signal(recording, name, values - (level + slope * (t - middle)), difference_of(signal.unit), sentence)


def subtract(recording: Recording, name: str, amount: float | str) -> Recording:
    """Take away a number in the signal's unit, or another signal of the recording, converted to that unit."""
    signal = signal_of(recording, name)
    if isinstance(amount, str):
        other = signal_of(recording, amount)
        values = other.values
        if (signal.unit is None) != (other.unit is None):
            raise UnitError(f"subtract({name!r}, {amount!r}): one of them has no unit; give both units when reading.")
        if signal.unit is not None and other.unit is not None:
            factor, offset = factor_offset(other.unit, signal.unit)
            values = values * factor + offset
        about = f"Signal {amount!r}"
    else:
        values, about = _number(amount, f"subtract({name!r}): amount"), f"{amount:g}"
    sentence = f"{about} was subtracted from all {len(recording)} samples of {name!r}."
    # a number may correct a sensor, another signal leaves a difference
    unit = difference_of(signal.unit) if isinstance(amount, str) else signal.unit
    return with_signal(recording, name, signal.values - values, unit, sentence)


def scale(recording: Recording, name: str, factor: float, unit: str | None = None) -> Recording:
    """Multiply by a gain of calibration; `unit` is that of the result (left out: the old one)."""
    signal = signal_of(recording, name)
    gain = _number(factor, f"scale({name!r}): factor")
    if unit is not None:
        parse(unit)
        _refuse_another_zero(name, signal.unit, unit)
    new = signal.unit if unit is None else unit
    sentence = (
        f"All {len(recording)} samples of {name!r} were multiplied by "
        f"{gain:g}{f' and are now in {new}' if unit is not None else ''}."
    )
    return with_signal(recording, name, signal.values * gain, new, sentence)


def _refuse_another_zero(name: str, old: str | None, new: str) -> None:
    """No factor alone takes a temperature from one zero to another."""
    if (
        old is not None
        and not of_another_kind(old)
        and compatible(old, new)
        and (is_point(old) or is_point(new))
        and not equal(old, new)
    ):
        raise UnitError(
            f"scale({name!r}): a factor alone does not take {old!r} to {new!r}, whose zero is another; write "
            f'{{ step = "convert_units", units = {{ {name} = "{new}" }} }}.'
        )


def convert_units(recording: Recording, units: Mapping[str, str]) -> Recording:
    """Convert signals to other units of the same dimension; raises UnitError, also for signals of unknown unit."""
    for name, unit in units.items():
        signal = signal_of(recording, name)
        if signal.unit is None:
            raise UnitError(
                f"Recording {recording.name!r}: signal {name!r} has no unit to "
                "convert from; state it in units where the recording is read."
            )
        factor, offset = factor_offset(signal.unit, unit)
        sentence = f"All {len(recording)} samples of {name!r} were converted from {signal.unit!r} to {unit!r}."
        recording = with_signal(recording, name, signal.values * factor + offset, unit, sentence)
    return recording


def _number(value: float, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise RecordingError(f"{what} is {value!r}; give a finite number.")
    return float(value)
