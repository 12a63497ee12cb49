"""What a study's own recordings propose for a loop: levels, limits, sample time, what the sensor resolves and its
noise."""

from collections.abc import Sequence

import numpy as np

from plantfit.recording.looks.rounded import even_grid

ROUND = 1e-6  # of a step of a sensor
SURE = 12  # levels, so many of which are not on one even grid by chance


def quantum_of(values: np.ndarray) -> float:
    """The step of a sensor that rounds: all differences of its values are multiples of it; 0 where there is none to
    see."""
    seen = np.unique(values[np.isfinite(values)])
    gaps = np.diff(seen)
    gaps = gaps[gaps > 1e-9 * max(float(np.ptp(seen)) if len(seen) else 0.0, 1e-300)]
    if len(gaps) < 3:
        return 0.0
    if len(seen) > 0.5 * len(values):  # a fine sensor of a signal that moves: few values come twice
        apart = seen[np.r_[True, np.diff(seen) > 1e-9 * np.ptp(seen)]]
        return (even_grid(apart) or 0.0) if len(apart) >= SURE else 0.0
    step = float(np.min(gaps))
    counts = gaps / step
    return step if np.all(np.abs(counts - np.rint(counts)) < 0.05 * np.maximum(counts, 1.0)) else 0.0


def noise_of(values: np.ndarray) -> float:
    """Standard deviation of the noise from sample to sample, by the median of second differences, which a slow
    signal hardly enters."""
    second = np.diff(values[np.isfinite(values)], 2)
    if len(second) < 3:
        return 0.0
    spread = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0)
    return spread if spread > 0 else float(np.std(second)) / np.sqrt(6.0)


def levels_of(values: Sequence[np.ndarray]) -> tuple[float, float]:
    """Where the output mostly was: the 10 % and 90 % quantiles of all its values."""
    every = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = np.quantile(every, (0.1, 0.9))
    if high <= low:
        low, high = float(every.min()), float(every.max())
    return float(low), float(high)


def rounded(value: float, size: float) -> float:
    """The value with as many digits as a hundredth of `size` takes."""
    if not (np.isfinite(size) and size > 0):
        return value
    digits = int(np.floor(np.log10(size))) - 1
    return float(round(value, -digits))
