"""Presliding of dry friction as a signal: the share of Coulomb friction that a path has built up."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import by_stretch, lost, require_positive, signal_of, with_signal
from plantfit.recording.record import Recording


def presliding(recording: Recording, signal: str, name: str, distance: float, start: float = 0.0) -> Recording:
    """Add the friction state z in (-1, 1) of a measured path as `name`, without unit.

    dz/dq = (1 - z sgn(dq))/distance, `distance` in the signal's unit: the model of Dahl (Aerospace Corp.
    TOR-0158(3107-18)-1, 1968) with exponent 1. Sliding far one way gives the sign of the motion; at rest z stays, where
    a sign of the velocity would be noise. Begins at `start`, anew after missing samples.
    """
    source = signal_of(recording, signal)
    step = f"presliding({signal!r})"
    distance = require_positive(distance, f"{step}: distance")
    if not -1 <= start <= 1:
        raise RecordingError(f"{step}: start is {start!r}; give a number from -1 to 1.")
    values = by_stretch(source.values, 2, lambda part, _: dahl_state(part, distance, start))
    sentence = f"{name!r} is the presliding state of {signal!r} over {distance:g} {source.unit or ''}".rstrip()
    return with_signal(recording, name, values, "", f"{sentence}{lost(source.values, values)}.")


def dahl_state(path: np.ndarray, distance: float, start: float = 0.0) -> np.ndarray:
    """The friction state (n,) along a path (n,), exact for straight pieces between samples."""
    moved = np.diff(path)
    decay, goal = np.exp(-np.abs(moved) / distance).tolist(), np.sign(moved).tolist()
    z = [start]
    for a, b in zip(decay, goal, strict=True):
        z.append(b + (z[-1] - b) * a)
    return np.array(z)
