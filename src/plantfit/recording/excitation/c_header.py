"""A waveform as a C header of 16-bit steps, for firmware that plays it by itself."""

import os
import re
from pathlib import Path

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import signal_of, uniform_period
from plantfit.recording.record import Recording

_LARGEST = 32767


def to_c_header(recording: Recording, path: str | os.PathLike[str], name: str = "V", step: float | None = None) -> Path:
    """Write `c_header(recording, name, step)` to a file and return its path."""
    file = Path(path)
    try:
        file.write_text(c_header(recording, name, step, identifier=file.stem), "utf-8")
    except OSError as error:
        raise RecordingError(
            f"File {str(file)!r} cannot be written ({error.strerror}); choose another place."
        ) from None
    return file


def c_header(recording: Recording, name: str = "V", step: float | None = None, identifier: str = "excitation") -> str:
    """C99 text: an `int16_t` table, its length, its period in us and the value of one step.

    `step` in the signal's unit, as in 12/255 for the duty of an 8-bit PWM at 12 V; left out, the
    finest that 16 bits hold. Raises RecordingError for missing samples, uneven times, a period that
    is not whole in us, and values that do not fit.
    """
    signal, period = signal_of(recording, name), uniform_period(recording, "a C header")
    if not np.all(np.isfinite(signal.values)):
        raise RecordingError(
            f"Recording {recording.name!r}: {name!r} has missing samples; fill them with fill_gaps first."
        )
    us = round(period * 1e6)
    if us < 1 or abs(period * 1e6 - us) > 1e-3:
        raise RecordingError(
            f"Recording {recording.name!r}: its period of {period * 1e6:g} "
            "us is not a whole number; choose another rate."
        )
    peak = float(np.max(np.abs(signal.values)))
    step = (peak / _LARGEST or 1.0) if step is None else step
    if not (np.isfinite(step) and step > 0 and round(peak / step) <= _LARGEST):
        raise RecordingError(
            f"A step of {step!r} cannot hold {peak:g} in 16 bits; give a step of at least {peak / _LARGEST:.3g}."
        )
    steps = np.rint(signal.values / step).astype(int).tolist()
    word = re.sub(r"\W", "_", identifier)
    word = f"_{word}" if word[:1].isdigit() else word
    upper = word.upper()
    rows = [", ".join(str(v) for v in steps[k : k + 16]) for k in range(0, len(steps), 16)]
    story = "".join(f" * {' '.join(line.split())}\n".replace("*/", "* /") for line in recording.log)
    return (
        f"/* {name} [{signal.unit or '-'}] = {upper}_STEP * {word}[k], held for {upper}_PERIOD_US.\n{story} */\n"
        f"#ifndef {upper}_H\n#define {upper}_H\n\n#include <stdint.h>\n\n"
        f"#define {upper}_LENGTH {len(steps)}u\n#define {upper}_PERIOD_US {us}u\n#define {upper}_STEP {step!r}\n\n"
        f"static const int16_t {word}[{upper}_LENGTH] = {{\n    "
        + ",\n    ".join(rows)
        + f"\n}};\n\n#endif /* {upper}_H */\n"
    )
