"""Parts of a recording, and its place on the time axis."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal

PART = 1e-9  # of a piece, by which a sample may miss its mark


def cut(recording: Recording, start: float | None = None, stop: float | None = None) -> Recording:
    """The samples with start <= t <= stop in seconds; times stay as they are. Raises RecordingError when none is
    left."""
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
            f"split: a share of {share:g} of {len(recording)} samples "
            "leaves a part with fewer than 2; use a longer recording."
        )
    before = np.arange(len(recording)) < first
    parts = ((before, "train", "first"), (~before, "valid", "last"))
    train, valid = (
        _rows(
            recording,
            keep,
            f"{recording.name}_{name}",
            f"The {which} {int(keep.sum())} of {len(recording)} samples, split at {share:g}.",
        )
        for keep, name, which in parts
    )
    return train, valid


def pieces(recording: Recording, seconds: float) -> list[Recording]:
    """The recording in pieces of about `seconds`, all equally long and none of its samples left out, named NAME-1,
    NAME-2, ...

    Raises RecordingError for a time that does not hold two samples.
    """
    t, count = recording.t, len(recording)
    span = float(t[-1] - t[0])
    number = max(1, round(span / seconds)) if np.isfinite(seconds) and seconds > 0 else count
    if number > count / 2:
        raise RecordingError(
            f"Recording {recording.name!r} has {count} samples over {span:g} s, and "
            f"pieces of {seconds:g} s do not hold two samples each; give a longer time."
        )
    marks = np.searchsorted(t, t[0] + span * (np.arange(1, number) / number) - PART * seconds)
    found = []
    for k, rows in enumerate(np.split(np.arange(count), marks), 1):
        if len(rows) < 2:
            raise RecordingError(
                f"Recording {recording.name!r}: piece {k} of {number}, up to "
                f"{t[0] + span * k / number:g} s, has {len(rows)} of the 2 samples that it needs; give "
                f"a longer time than {seconds:g} s, or two recordings, cut before and after a gap."
            )
        sentence = f"Piece {k} of {number}: {len(rows)} of {count} samples, from {t[rows[0]]:g} s to {t[rows[-1]]:g} s."
        found.append(_rows(recording, np.isin(np.arange(count), rows), f"{recording.name}-{k}", sentence))
    return found


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
