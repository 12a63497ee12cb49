"""Samples that no model should follow: far from their neighbours' residuals, and few."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import Carrier, Rows
from plantfit.trust.diagnosis.plant.hypothesis import Fitted

WINDOW, FAR, MOST = 11, 6.0, 0.1  # samples around, robust deviations, share of all samples
BEHIND = 3  # samples after a step of an input, in which what acts between samples shows; it fades in WINDOW of them
STEPS, MANY = 0.1, 0.5  # share of samples at which an input that steps does so, and of outliers that stand behind steps
_TO_SD = 1.4826  # median absolute deviation of a normal distribution to its standard deviation


@dataclass(frozen=True)
class Outliers:
    """Samples that lie apart from their neighbours: how many of how many by output, and their share of the squares
    of the residual, that of the model with the additions `beside`. `behind` are samples by output that lie as far, but
    right behind steps of inputs, which are no outliers, and `behind_share` is their share of the squares."""

    counts: dict[str, tuple[int, int]]
    share: float
    beside: tuple[Extension, ...] = ()
    behind: dict[str, int] = field(default_factory=dict)
    behind_share: float = 0.0

    @property
    def of_steps(self) -> dict[str, Any]:
        """What is known of samples behind steps."""
        return {"behind": self.behind, "behind_share": self.behind_share}

    @property
    def named(self) -> bool:
        """Whether they are worth a sentence: one sample in a million normal ones lies as far, some more where the
        noise has tails."""
        return self.share >= 0.05 and any(n >= max(2, 0.002 * m) for n, m in self.counts.values())


def outlying(residuals: np.ndarray, rows: Rows) -> np.ndarray:
    """Rows (m,) bool whose residual lies more than 6 robust deviations from the running median of its output; none
    where that would be more than a tenth of them (then they are no outliers)."""
    found = np.zeros(len(residuals), dtype=bool)
    for name in dict.fromkeys(rows.recording):
        for output in dict.fromkeys(rows.output):
            at = rows.part(name, output)
            at = at[(rows.fit | rows.unseen)[at]]
            if len(at) < 5 * WINDOW:
                continue
            r = residuals[at]
            padded = np.pad(r, WINDOW // 2, mode="reflect")
            windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
            away = r - np.median(windows, axis=1)
            # a step of the residual takes some samples; a spike stands alone, so that the local scale must not hold it
            scale = max(
                _TO_SD * float(np.median(np.abs(away))),
                1e-12 * float(np.max(np.abs(rows.measured[at]), initial=0.0)),
                1e-300,
            )
            local = _TO_SD * np.median(np.abs(windows - np.median(windows, axis=1)[:, None]), axis=1)
            far = np.abs(away) > FAR * np.maximum(scale, local)
            if np.mean(far) <= MOST:
                found[at] = far
    return found


def apart_of(residuals: np.ndarray, carrier: Carrier) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m,) bool that are outliers, and those that lie as far but right behind steps of inputs.

    Where the clock shakes, or a computer writes an input between two samples, the recorded step is a part of a sample
    early or late: the samples behind it are off, and right. A dead time that the model lacks looks alike.
    """
    far, rows = outlying(residuals, carrier.rows), carrier.rows
    behind = np.zeros(len(far), dtype=bool)
    if carrier.unordered:
        return far, behind
    for name in dict.fromkeys(rows.recording[far]):
        own = rows.recording == name
        near, fading = (own & _after_steps(carrier, name, k)[rows.sample] for k in (BEHIND, WINDOW))
        for output in dict.fromkeys(rows.output[far & own]):
            found = far & own & (rows.output == output)
            chance = float(np.mean(near[own & (rows.output == output)]))
            there = int(np.sum(found & near))
            if there >= 2 and there >= max(MANY, 3.0 * chance) * np.sum(found):
                behind |= found & fading
    return far & ~behind, behind


def _after_steps(carrier: Carrier, name: str, length: int) -> np.ndarray:
    """Whether a sample (n,) of a recording is one of the `length` behind a step of an input that is level else."""
    record = carrier.problem.experiments[name].recording
    found = np.zeros(max(len(record), int(np.max(carrier.rows.sample, initial=0)) + 1), dtype=bool)
    for u in getattr(carrier.problem.model, "inputs", {}):
        size = np.ptp(record[u])  # a carrier's inputs move by 1e-9 of it at every sample
        steps = np.flatnonzero(np.abs(np.diff(record[u])) > 1e-6 * size) + 1
        if 0 < len(steps) <= STEPS * len(record):
            steps = np.r_[0, steps] if length > BEHIND else steps  # a record begins with one, too, or in the middle
            for k in range(length):
                found[np.minimum(steps + k, len(record) - 1)] = True
    return found


def outliers_of(base: Fitted, apart: np.ndarray, carrier: Carrier, behind: np.ndarray) -> Outliers:
    """Of the rows that are `apart` (m,) bool from a fit, and of those right `behind` steps (m,) bool."""
    rows = carrier.rows
    scored = rows.fit | rows.unseen
    total = float(np.sum(base.residuals[scored] ** 2))
    share = float(np.sum(base.residuals[scored & apart] ** 2)) / total if total > 0 else 0.0
    counts = {
        o: (int(np.sum(apart & (rows.output == o))), int(np.sum(scored & (rows.output == o))))
        for o in dict.fromkeys(rows.output)
    }
    late = {o: n for o in counts if (n := int(np.sum(behind & (rows.output == o))))}
    their = float(np.sum(base.residuals[scored & behind] ** 2)) / total if total > 0 else 0.0
    return Outliers(counts, share, base.additions, late, their)
