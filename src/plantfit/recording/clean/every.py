"""The fresh samples of a signal that is read more seldom than its record is written."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import signal_of, with_signal
from plantfit.recording.record import Recording


def keep_every(recording: Recording, name: str, every: int, first: int = 0) -> Recording:
    """Mark as missing all samples of a signal but each `every`-th one, from sample `first` on (the first sample is 0).

    Raises RecordingError where `every` is no whole number from 2 on, or `first` none from 0 to below it.
    """
    signal = signal_of(recording, name)
    for what, given, least, most in (("every", every, 2, len(recording)), ("first", first, 0, every - 1)):
        if isinstance(given, bool) or not isinstance(given, int | np.integer) or not least <= given <= most:
            raise RecordingError(
                f"keep_every({name!r}): {what} is {given!r}; give a whole number from {least} to {most}."
            )
    values = np.full(len(recording), np.nan)
    values[first::every] = signal.values[first::every]
    return with_signal(
        recording, name, values, signal.unit, f"Of {name!r} every {every}th sample kept, from sample {first} on."
    )
