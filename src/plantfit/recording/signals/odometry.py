"""Pose of a robot with two driven wheels from the counts of their encoders."""

from collections.abc import Sequence

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import require_positive, signal_of, with_new
from plantfit.recording.record import Recording
from plantfit.recording.signals.encoder import unwrapped


def odometry(
    recording: Recording,
    left: str,
    right: str,
    counts: float,
    radius: float,
    track: float,
    ratio: float = 1.0,
    start: Sequence[float] = (0.0, 0.0, 0.0),
    wrap_bits: int | None = None,
) -> Recording:
    """Add the pose x, y (m), heading (rad, not wrapped) and the path travelled, distance (m), from both wheels' counts.

        eta = 2 pi ratio N / counts,  s = radius eta,  ds = (ds_right + ds_left)/2,  dheading = (ds_right -
        ds_left)/track dx = ds sinc cos(heading + dheading/2),  dy = ds sinc sin(heading + dheading/2),  sinc =
        sin(dheading/2)/(dheading/2)

    Exact where both wheels keep their speeds from sample to sample, and do not slip. `radius` of the wheels and `track`
    between them in m; `ratio` turns of the wheel for one of the encoder; `start` is the first pose; distance falls
    while driving backwards. Over missing samples one arc joins the counts before and after. Source: the 2018 paper of
    `encoder`, eq. 4 and 7; Siegwart, Nourbakhsh, Introduction to Autonomous Mobile Robots, section 5.2.4.
    """
    step = f"odometry({left!r}, {right!r})"
    scale = 2 * np.pi * require_positive(ratio, f"{step}: ratio") / require_positive(counts, f"{step}: counts")
    scale *= require_positive(radius, f"{step}: radius")
    width = require_positive(track, f"{step}: track")
    if len(start) != 3 or not np.all(np.isfinite(start)):
        raise RecordingError(f"{step}: start is {start!r}; give x and y in m and the heading in rad.")
    paths = [scale * unwrapped(signal_of(recording, wheel).values, wrap_bits, step) for wheel in (left, right)]
    there = np.isfinite(paths[0]) & np.isfinite(paths[1])
    if not there.any():
        raise RecordingError(f"{step}: no sample has both counts; choose other signals.")
    dl, dr = (np.diff(p[there]) for p in paths)
    made = {name: np.full(len(recording), np.nan) for name in ("x", "y", "heading", "distance")}
    for name, values in zip(made, pose_along(dl, dr, width, start), strict=True):
        made[name][there] = values
    told = f"Pose by odometry from {left!r} and {right!r} ({counts:g} counts, radius {radius:g} m, track {track:g} m)"
    for name, unit in (("x", "m"), ("y", "m"), ("heading", "rad"), ("distance", "m")):
        recording = with_new(recording, name, made[name], unit, f"{told}: {name!r}, {int(there.sum())} samples.", step)
    return recording


def pose_along(dl: np.ndarray, dr: np.ndarray, track: float, start: Sequence[float]) -> tuple[np.ndarray, ...]:
    """x, y (m), heading (rad), distance (m), each (n + 1,), from the paths (n,) of the left and the right wheel (m),
    an arc each."""
    ds, turn = 0.5 * (dl + dr), (dr - dl) / track
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    chord, middle = ds * np.sinc(turn / (2 * np.pi)), heading[:-1] + 0.5 * turn
    x = start[0] + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = start[1] + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    return x, y, heading, np.concatenate([[0.0], np.cumsum(ds)])
