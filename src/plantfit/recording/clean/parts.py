"""Parts of a recording, and its place on the time axis."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal


def cut(recording: Recording, start: float | None = None, stop: float | None = None) -> Recording:
    """The samples with start <= t <= stop in seconds; times stay as they are. Raises RecordingError when none is left."""
    low = -np.inf if start is None else start
    high = np.inf if stop is None else stop
    keep = (recording.t >= low) & (recording.t <= high)
    if not keep.any():
        raise RecordingError(
            f"Recording {recording.name!r} has no samples from {low:g} s to {high:g} s; "
            f"it lasts from {recording.t[0]:g} s to {recording.t[-1]:g} s."
        )
    sentence = f"Cut to {low:g} s to {high:g} s: {int(keep.sum())} of {len(recording)} samples kept."
    return _rows(recording, keep, recording.name, sentence)


def split(recording: Recording, share: float) -> tuple[Recording, Recording]:
    """(first `share` of the samples, the rest), named with "_train" and "_valid"; both need two samples."""
    if not 0 < share < 1:
        raise RecordingError(f"split: share is {share!r}; give a number between 0 and 1, such as 0.7.")
    first = round(share * len(recording))
    if first < 2 or len(recording) - first < 2:
        raise RecordingError(
            f"split: a share of {share:g} of {len(recording)} samples leaves a part with fewer than 2; use a longer recording."
        )
    before = np.arange(len(recording)) < first
    parts = ((before, "train", "first"), (~before, "valid", "last"))
    train, valid = (
        _rows(
            recording, keep, f"{recording.name}_{name}", f"The {which} {int(keep.sum())} of {len(recording)} samples, split at {share:g}."
        )
        for keep, name, which in parts
    )
    return train, valid


def shift_time(recording: Recording, seconds: float | None = None) -> Recording:
    """Add `seconds` to all times; left out, the recording starts at 0."""
    by = -float(recording.t[0]) if seconds is None else float(seconds)
    if not np.isfinite(by):
        raise RecordingError(f"shift_time: seconds is {seconds!r}; give a finite number.")
    sentence = f"All {len(recording)} times were shifted by {by:g} s."
    return Recording(recording.t + by, recording.signals, recording.name, (*recording.log, sentence), recording.clocked)


def _rows(recording: Recording, keep: np.ndarray, name: str, sentence: str) -> Recording:
    signals = {key: Signal(signal.values[keep], signal.unit) for key, signal in recording.signals.items()}
    return Recording(recording.t[keep], signals, name, (*recording.log, sentence), recording.clocked)
