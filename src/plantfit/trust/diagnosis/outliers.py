"""Samples that no model should follow: far from their neighbours' residuals, and few."""

from dataclasses import dataclass

import numpy as np

from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.carrier import Carrier, Rows
from plantfit.trust.diagnosis.plant.hypothesis import Fitted

WINDOW, FAR, MOST = 11, 6.0, 0.1  # samples around, robust deviations, share of all samples
_TO_SD = 1.4826  # median absolute deviation of a normal distribution to its standard deviation


@dataclass(frozen=True)
class Outliers:
    """Samples that lie apart from their neighbours: how many of how many by output, and their share of the squares
    of the residual, that of the model with the additions `beside`."""

    counts: dict[str, tuple[int, int]]
    share: float
    beside: tuple[Extension, ...] = ()

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


def outliers_of(base: Fitted, apart: np.ndarray, carrier: Carrier) -> Outliers:
    """Of the rows that are `apart` (m,) bool from a fit."""
    rows = carrier.rows
    scored = rows.fit | rows.unseen
    total = float(np.sum(base.residuals[scored] ** 2))
    share = float(np.sum(base.residuals[scored & apart] ** 2)) / total if total > 0 else 0.0
    counts = {
        o: (int(np.sum(apart & (rows.output == o))), int(np.sum(scored & (rows.output == o))))
        for o in dict.fromkeys(rows.output)
    }
    return Outliers(counts, share, base.additions)
