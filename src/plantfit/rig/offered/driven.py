"""What drives a rig: values held one after another, or a signal of a recording."""

import os

import numpy as np

from plantfit import units
from plantfit.errors import SimulationError, UnitError
from plantfit.recording.readers.any_format import read
from plantfit.recording.record import Recording, Signal


def driven_by(
    excitation: str | Recording, signal: str, unit: str, duration: float, period: float
) -> tuple[Recording, str]:
    """The excitation sampled every `period` s as a recording with `signal` in `unit`, and a sentence about it.

    Text is one value with or without a unit, several with commas between, each for an equal share of `duration` (s), or
    the name of a file with that signal, which sets the duration. Raises SimulationError for other text, UnitError for a
    wrong unit.
    """
    if isinstance(excitation, Recording):
        return _of_recording(excitation, signal, unit)
    if os.path.exists(excitation) or excitation.lower().endswith(
        (".csv", ".csv.gz", ".txt", ".mat", ".npz", ".parquet", ".xlsx")
    ):
        return _of_recording(read(excitation), signal, unit)
    levels = [_level(part, excitation, unit) for part in excitation.split(",")]
    t = np.arange(round(duration / period) + 1) * period
    place = np.minimum((np.arange(len(t)) * len(levels)) // max(len(t) - 1, 1), len(levels) - 1)
    shown = ", ".join(f"{v:g}" for v in levels)
    each = f", each for {duration / len(levels):g} s" if len(levels) > 1 else " from the start"
    return Recording(
        t, {signal: Signal(np.array(levels)[place], unit)}, "excitation"
    ), f"{signal} = {shown} {unit}{each}."


def _of_recording(given: Recording, signal: str, unit: str) -> tuple[Recording, str]:
    if signal not in given.signals:
        raise SimulationError(f"The excitation {given.name!r} has no signal {signal!r}; it has {list(given.signals)}.")
    own = given.signals[signal]
    if not np.all(np.isfinite(own.values)):
        raise SimulationError(f"The excitation {given.name!r} has missing values of {signal!r}; fill them first.")
    values = own.values if own.unit is None else units.convert(own.values, own.unit, unit)
    return Recording(
        given.t, {signal: Signal(values, unit)}, given.name, given.log
    ), f"{signal} of the recording {given.name!r}."


def _level(part: str, whole: str, unit: str) -> float:
    try:
        value, own = units.quantity(part)
    except UnitError:
        raise SimulationError(
            f"The excitation {whole!r} is no value and no file; write a value such as 6{unit}, several such as "
            f"3{unit},6{unit}, or the "
            "name of a CSV file that is there."
        ) from None
    return float(units.convert(value, own, unit)) if own else value
