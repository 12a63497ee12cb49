"""Signals that look back in time, put at the times that they tell of."""

from collections.abc import Sequence

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import signal_of
from plantfit.recording.record import Recording, Signal
from plantfit.units import factor_offset

_ROUNDING = 1e-9  # of a sampling period


def backdate(recording: Recording, signal: str | Sequence[str], by: float | str, hold: Sequence[str] = ()) -> Recording:
    """Move the samples of a signal, or of several alike, `by` seconds back, or by the values of a signal of time, each
    by its own.

    For sensors whose reading tells of an earlier time: half the window for a mean or an RMS, `lag` of
    `period_to_speed`. No value is changed or interpolated; the recording gets further times, at which all other signals
    are missing but those of `hold`, the inputs, which keep their last value. Samples that fall before the start are
    dropped. Raises RecordingError for a delay below 0.
    """
    names = [signal] if isinstance(signal, str) else list(signal)
    step = f"backdate({names[0]!r})" if len(names) == 1 else f"backdate({names})"
    late, said = _delays(recording, by, step)
    own, t = {name: signal_of(recording, name) for name in names}, recording.t
    there = np.any([np.isfinite(s.values) for s in own.values()], axis=0)
    wrong = there & ~(np.isfinite(late) & (late >= 0))
    if np.any(wrong):
        at = int(np.argmax(wrong))
        raise RecordingError(
            f"{step}: the delay at {t[at]:g} s is {late[at]:g} s; give 0 or more wherever there is a value."
        )
    then = _on_samples(t - np.where(there, late, 0.0), t)
    there &= then >= t[0]
    moved, place = np.unique(then[there], return_index=True)  # of samples that meet in one time the first stays
    times = np.union1d(t, moved)
    before = np.searchsorted(t, times, side="right") - 1
    signals = {}
    for name, given in recording.signals.items():
        kept = given.values[before]
        signals[name] = Signal(kept if name in hold else np.where(t[before] == times, kept, np.nan), given.unit)
    for name in hold:
        signal_of(recording, name)
    for name, given in own.items():
        values = np.full(len(times), np.nan)
        values[np.searchsorted(times, moved)] = given.values[there][place]
        signals[name] = Signal(values, given.unit)
    whom = " and ".join(repr(name) for name in names)
    sentence = f"{len(moved)} samples of {whom} were moved back by {said}; {len(t)} times became {len(times)}."
    return Recording(times, signals, recording.name, (*recording.log, sentence))


def _on_samples(times: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Times (n,) that miss one of t (m,) by rounding alone moved onto it: 0.3 s - 0.1 s is the sample at 0.2 s, and
    not one before it."""
    if len(t) < 2:
        return times
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    near = np.where(times - t[after - 1] < t[after] - times, t[after - 1], t[after])
    return np.where(np.abs(times - near) <= _ROUNDING * float(np.median(np.diff(t))), near, times)


def _delays(recording: Recording, by: float | str, step: str) -> tuple[np.ndarray, str]:
    """Delays (n,) in s, and how a log calls them."""
    if isinstance(by, str):
        given = signal_of(recording, by)
        if given.unit is None:
            raise RecordingError(
                f"{step}: the delay {by!r} has no unit; state it in units where the recording is read, such as 's'."
            )
        return given.values * factor_offset(given.unit, "s")[0], f"{by!r}"
    if isinstance(by, bool) or not isinstance(by, (int, float, np.number)) or not np.isfinite(by):
        raise RecordingError(f"{step}: by is {by!r}; give seconds, or the name of a signal of them.")
    return np.full(len(recording), float(by)), f"{by:g} s"
