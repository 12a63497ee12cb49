"""Outputs that a recording does not hold, as missing samples: another recording of the same fit does."""

from collections.abc import Sequence

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal


def unmeasured(recording: Recording, names: Sequence[str]) -> Recording:
    """The recording with every sample of the signals `names` missing (NaN), so that a fit does not score them here.

    Raises RecordingError for a signal that the recording has.
    """
    for name in names:
        if name in recording.signals:
            raise RecordingError(
                f"Recording {recording.name!r} has the signal {name!r}, "
                "but unmeasured names it too; remove one of the two."
            )
    missing = {name: Signal(np.full(len(recording.t), np.nan), None) for name in names}
    log = [f"{name}: not measured here." for name in names]
    return Recording(
        recording.t, {**recording.signals, **missing}, recording.name, (*recording.log, *log), recording.clocked
    )
