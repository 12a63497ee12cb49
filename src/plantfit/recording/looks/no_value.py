"""Whether one number stands for no value, as -999 does in the files of many loggers."""

import numpy as np

from plantfit.recording.looks.look import MARKED, Look
from plantfit.recording.record import Recording

TWICE = 2  # samples at least that have the number
MOST = 0.2  # of the samples: what a signal is so often is a state of the plant
LEVELS = 10  # that the others have: a switch has few
APART = 1.0  # times the range of all others, from the nearest of them
SHORT = 3.0  # samples in a row in the mean: an interruption, and no other state of the plant
FAR = 5.0  # times that range: so far away no sensor ends and no plant goes, and an interruption may be long
BACK = 0.5  # of the way to the number, by which the signal may be elsewhere behind it


def no_value_look(recording: Recording, name: str) -> Look | None:
    """That a signal is exactly one number, far from all others, for a sample or a few now and then, and goes on as
    before; None where it is not so."""
    y = recording[name]
    good = np.flatnonzero(np.isfinite(y))
    values = y[good]
    for end in (float(values.min()), float(values.max())):
        at = values == end
        others = values[~at]
        if not (TWICE <= at.sum() <= MOST * len(values)) or len(np.unique(others)) < LEVELS:
            continue
        low, high = float(others.min()), float(others.max())
        away = max(low - end, end - high)
        most = np.inf if end != 0.0 and away >= FAR * (high - low) else SHORT  # a plant at rest shows 0
        if away < APART * (high - low) or not _interrupts(values, at, away, most):
            continue
        unit = f" {recording.signals[name].unit}" if recording.signals[name].unit not in (None, "", "1") else ""
        times = recording.t[good][at]
        # the study file names what stands in the file
        write = "" if any(f"{name}: converted from" in line for line in recording.log) else f"missing = [{end:.9g}]"
        return Look(
            "no_value", "warning", recording.name, name,
            f"{int(at.sum())} samples of {name} are exactly {end:.6g}{unit}, far from all others ({low:.4g} to "
            f"{high:.4g}{unit}), which go on behind them as before: the number seems to stand for no value.",
            float(times[0]), float(times[-1]), write, {"samples": int(at.sum()), "value": end},
            times[:MARKED].tolist(),
        )  # fmt: skip
    return None


def _interrupts(values: np.ndarray, at: np.ndarray, away: float, most: float) -> bool:
    """Whether the samples `at` (n,) bool come at `most` so many in a row in the mean, and the signal (n,) is behind
    them where it was before."""
    edges = np.flatnonzero(np.diff(np.r_[False, at, False].astype(int)))
    begins, ends = edges[::2], edges[1::2]
    if float(np.mean(ends - begins)) > most:
        return False
    inside = (begins > 0) & (ends < len(values))
    return bool(np.all(np.abs(values[ends[inside]] - values[begins[inside] - 1]) < BACK * away))
