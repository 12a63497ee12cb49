"""The cut-off of a low-pass filter by a stated rule, from the recording itself."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from scipy.optimize import brentq

from plantfit.errors import RecordingError
from plantfit.recording.clean.butterworth import smooth
from plantfit.recording.clean.sampling import require_positive, signal_of, uniform_period
from plantfit.recording.record import Recording
from plantfit.recording.signals.smoother import kalman_smoother

CutoffRule = Literal["likelihood", "gcv", "residual", "discrepancy"]
_NAMES = {
    "likelihood": "the largest likelihood of integrated white noise",
    "gcv": "generalised cross-validation",
    "residual": "residual analysis",
    "discrepancy": "the known noise",
}
_LEAST = 40  # samples
_STRAIGHT = 0.95  # squared correlation of the part of the residual curve that counts as a line


@dataclass(frozen=True)
class Cutoff:
    """A cut-off in Hz, the noise (standard deviation, in the signal's unit) that it takes for granted, and why."""

    frequency: float
    noise: float
    rule: str
    sentence: str


def cutoff_frequency(
    recording: Recording, signal: str, rule: CutoffRule = "likelihood", noise: float | None = None, order: int = 3
) -> Cutoff:
    """The cut-off in Hz for a zero-phase Butterworth low-pass of `order`, found by `rule`.

    "likelihood": the most likely integrated-white-noise model, whose smoother has that cut-off (`kalman`, eq. 2);
    uneven steps too. "gcv": generalised cross-validation of the same smoother (Craven, Wahba, Numerische Mathematik 31,
    1979). "residual": residual analysis (Winter, Biomechanics and Motor Control of Human Movement, 4th ed. 2009,
    section 3.4.4.3). "discrepancy": what the filter removes has the size of the known `noise` (Morozov, Soviet
    Mathematics Doklady 7, 1966), for an encoder its step/sqrt(12). The last two need even steps. Raises RecordingError
    where a rule finds none.
    """
    step = f"cutoff_frequency({signal!r})"
    if rule not in get_args(CutoffRule):
        raise RecordingError(f"{step}: rule is {rule!r}; use one of {', '.join(map(repr, get_args(CutoffRule)))}.")
    if rule == "discrepancy" and noise is None:
        raise RecordingError(
            f"{step}: rule 'discrepancy' needs noise=, the standard "
            "deviation of the noise; an encoder has its step/sqrt(12)."
        )
    if noise is not None:
        noise = require_positive(noise, f"{step}: noise")
    there = _longest_stretch(recording, signal, step)
    values = signal_of(recording, signal).values[there]
    if rule in ("likelihood", "gcv"):
        found = kalman_smoother(recording.t[there], values, rule, noise, order)
        frequency, left, how = found.cutoff, found.noise, _NAMES[rule]
    else:
        period = uniform_period(recording, step)
        left = _intercept(values, period, order, step) if noise is None else noise
        frequency, how = _removing(left, values, period, order, step), _NAMES[rule]
    return Cutoff(
        frequency, left, rule, f"Cut-off of {signal!r} {frequency:.3g} Hz by {how}, which leaves noise of {left:.3g}."
    )


def resolve_cutoff(
    recording: Recording, signal: str, cutoff: float | CutoffRule, order: int, noise: float | None = None
) -> tuple[float, str]:
    """A cut-off given as a number or as the name of a rule: (Hz, sentence for the log or nothing)."""
    if isinstance(cutoff, str):
        found = cutoff_frequency(recording, signal, cutoff, noise, order)
        return found.frequency, " " + found.sentence
    return cutoff, ""


def _longest_stretch(recording: Recording, signal: str, step: str) -> slice:
    good = np.isfinite(signal_of(recording, signal).values)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int))).reshape(-1, 2)
    start, stop = max(edges.tolist(), key=lambda e: e[1] - e[0], default=(0, 0))
    if stop - start < _LEAST:
        raise RecordingError(
            f"{step}: the longest stretch without missing samples has {stop - start} samples, and a rule needs "
            f"{_LEAST}; fill the gaps first, or give cutoff in Hz."
        )
    return slice(start, stop)


def _intercept(values: np.ndarray, period: float, order: int, step: str) -> float:
    """The noise by residual analysis: the straight part of the residual's curve over the cut-off, drawn on to 0 Hz."""
    cutoffs = np.linspace(0.01, 0.5, 50) * 0.5 / period
    left = np.array([_removed(values, period, fc, order, step) for fc in cutoffs])
    start = next(
        (k for k in range(len(cutoffs) - 10) if np.corrcoef(cutoffs[k:], left[k:])[0, 1] ** 2 >= _STRAIGHT), None
    )
    if start is None:
        raise RecordingError(
            f"{step}: the residual over the cut-off has no straight "
            "part, the noise is not white; use rule 'likelihood'."
        )
    return float(np.polyfit(cutoffs[start:], left[start:], 1)[1])


def _removing(noise: float, values: np.ndarray, period: float, order: int, step: str) -> float:
    """The cut-off whose filter removes `noise` (rms)."""

    def excess(log_cutoff: float) -> float:
        return _removed(values, period, float(np.exp(log_cutoff)), order, step) - noise

    low, high = np.log(1.0 / (period * len(values))), np.log(0.45 / period)
    if not excess(low) > 0 > excess(high):
        raise RecordingError(
            f"{step}: no cut-off removes noise of {noise:.3g}; between {np.exp(low):.2g} "
            f"and {np.exp(high):.2g} Hz the filter removes {excess(low) + noise:.3g} to "
            f"{excess(high) + noise:.3g}. Correct noise= or use rule 'likelihood'."
        )
    root: Any = brentq(excess, low, high, xtol=1e-4)
    return float(np.exp(root))


def _removed(values: np.ndarray, period: float, cutoff: float, order: int, step: str) -> float:
    return float(np.sqrt(np.mean((values - smooth(values, period, cutoff, order, False, step)) ** 2)))
