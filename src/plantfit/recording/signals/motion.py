"""A measured path with its velocity and acceleration, all by one Kalman smoother."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.cutoff import CutoffRule, resolve_cutoff
from plantfit.recording.clean.sampling import by_stretch, lost, signal_of, with_signal
from plantfit.recording.record import Recording
from plantfit.recording.signals.smoother import kalman_smoother
from plantfit.units import per_second


def smooth_motion(
    recording: Recording,
    signal: str,
    velocity: str,
    acceleration: str,
    cutoff: float | CutoffRule = "likelihood",
    *,
    noise: float | None = None,
    order: int = 3,
) -> Recording:
    """Smooth a path on its own time stamps, even or not, and add its `velocity` and `acceleration` as signals of these
    names.

    The smoother is that of `differentiate(method="kalman")`; `cutoff` in Hz, or a rule of `cutoff_frequency` with its
    `noise`. Unlike a velocity and an acceleration made apart, the three belong to one path. Raises RecordingError for
    names that are taken.
    """
    source = signal_of(recording, signal)
    step = f"smooth_motion({signal!r})"
    for name in (velocity, acceleration):
        if name in recording.signals:
            raise RecordingError(
                f"{step}: recording {recording.name!r} already has a signal {name!r}; give another name."
            )
    if order not in (3, 4):
        raise RecordingError(f"{step}: order is {order!r}; give 3 or 4.")
    frequency, why = resolve_cutoff(recording, signal, cutoff, order, noise)
    states = np.full((len(recording), 3), np.nan)

    def fill(part: np.ndarray, place: slice) -> np.ndarray:
        states[place] = kalman_smoother(recording.t[place], part, frequency, order=order).states[:, :3]
        return part

    by_stretch(source.values, 2 * order + 1, fill)
    rate = None if source.unit is None else per_second(source.unit)
    sentence = (
        f"{signal!r} Kalman smoothed at {frequency:.3g} Hz, with {velocity!r} and "
        f"{acceleration!r}{lost(source.values, states[:, 0])}."
    )
    recording = with_signal(recording, signal, states[:, 0], source.unit, sentence + why)
    signals = {**recording.signals}
    for name, unit, column in ((velocity, rate, 1), (acceleration, None if rate is None else per_second(rate), 2)):
        signals[name] = type(source)(states[:, column], unit)
    return Recording(recording.t, signals, recording.name, recording.log, recording.clocked)
