"""A recording with a staircase of an input, cut where the input moves."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.parts import cut
from plantfit.recording.clean.sampling import signal_of
from plantfit.recording.record import Recording


def levels(recording: Recording, signal: str) -> list[Recording]:
    """One recording for each stretch over which `signal` keeps its value, in order, named with "_1", "_2", ...

    Times stay as they are. Raises RecordingError where the signal never moves, or moves with more than every tenth
    sample.
    """
    values = signal_of(recording, signal).values
    moved = np.flatnonzero(np.diff(values) != 0) + 1
    if not 0 < len(moved) <= len(values) / 10:
        said = "never moves" if not len(moved) else f"moves at {len(moved)} of {len(values)} samples"
        raise RecordingError(
            f"levels: signal {signal!r} of recording {recording.name!r} "
            f"{said}; give an input that was changed in steps."
        )
    ends = [*(recording.t[moved - 1]), recording.t[-1]]
    starts = [recording.t[0], *recording.t[moved]]
    pieces = [cut(recording, start, stop) for start, stop in zip(starts, ends, strict=True)]
    return [Recording(p.t, p.signals, f"{recording.name}_{k + 1}", p.log) for k, p in enumerate(pieces)]
