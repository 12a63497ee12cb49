"""Bands of predicted outputs: where the plant may be for all parameters that the data allow, and where a sensor will
read it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

MOST_MIXED = 100  # draws that readings are mixed of
HALVINGS = 30  # of the range in which an end of a band is looked for


@dataclass(frozen=True)
class Band:
    """Of one output over a recording, in its unit: `value` (n,) of the answer; between `low` and `high` (n,) the
    plant lies, between `read_low` and `read_high` (n,) a reading of it, each with the probability that was asked for
    at each sample by itself."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    read_low: np.ndarray
    read_high: np.ndarray

    def held(self, measured: np.ndarray) -> float:
        """Share of measured values (n,) that lie between `read_low` and `read_high`; NaN where nothing was measured."""
        there = np.isfinite(measured)
        inside = (measured >= self.read_low) & (measured <= self.read_high)
        return float(np.mean(inside[there])) if np.any(there) else float("nan")


def bands(
    predict: Callable[[Any], Mapping[str, np.ndarray]],
    values: np.ndarray,
    noise: Mapping[str, float],
    level: float,
) -> dict[str, Band]:
    """Bands by output at `level` from draws (K, ...) of what `predict` takes, the answer first; `noise` is the standard
    deviation of readings."""
    courses = [predict(v) for v in values]
    tails = [0.5 - level / 2, 0.5 + level / 2]
    found = {}
    for output in courses[0]:
        drawn = np.stack([c[output] for c in courses])
        drawn = drawn[np.all(np.isfinite(drawn), axis=1)]
        low, high = np.quantile(drawn, tails, axis=0)
        read_low, read_high = (_mixed(drawn[:MOST_MIXED], noise.get(output, 0.0), q) for q in tails)
        found[output] = Band(courses[0][output], low, high, read_low, read_high)
    return found


def _mixed(drawn: np.ndarray, noise: float, share: float) -> np.ndarray:
    """Quantiles (n,) of readings that scatter normally, by `noise`, about courses (K, n), each as likely as the
    others."""
    if noise <= 0:
        return np.quantile(drawn, share, axis=0)
    low, high = drawn.min(axis=0) - 6 * noise, drawn.max(axis=0) + 6 * noise
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        below = np.mean(ndtr((middle - drawn) / noise), axis=0) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
