"""A waveform kept within what an amplifier and a plant may take."""

from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import period_of, signal_of, with_signal
from plantfit.recording.excitation.waveform import positive
from plantfit.recording.record import Recording

_LEAST_SWING = 0.5  # of the rms about the mean that must be left after the slew limit


def limited(
    recording: Recording,
    name: str = "V",
    *,
    voltage: float | None = None,
    duty: float | None = None,
    supply: float | None = None,
    slew: float | None = None,
    how: Literal["scale", "clip"] = "scale",
) -> Recording:
    """Keep |value| <= `voltage`, |value| <= `duty` * `supply` and the change per second <= `slew`; the log says what
    changed.

    Units are those of the signal; `duty` is a share from 0 to 1. What is too large is scaled as a
    whole, which keeps the shape, or clipped with how="clip". Steeper changes become ramps,
    also the first one from 0. Raises RecordingError for limits that cannot be, and where the
    slew limit leaves less than half of the signal's swing (rms about its mean).
    """
    signal = signal_of(recording, name)
    bound, reason = _bound(voltage, duty, supply)
    if how not in ("scale", "clip"):
        raise RecordingError(f"limited({name!r}): how is {how!r}; use 'scale' or 'clip'.")
    values, unit, said = signal.values, signal.unit or "", []
    peak = float(np.max(np.abs(values)))
    if peak > bound:
        if how == "scale":
            values = values * (bound / peak)
            said.append(f"scaled by {bound / peak:.4g} so that the peak of {peak:g} {unit} meets the {reason}")
        else:
            said.append(f"{int(np.sum(np.abs(values) > bound))} samples beyond the {reason} clipped")
            values = np.clip(values, -bound, bound)
    if slew is not None:
        positive("limited", slew=slew)
        values, ramped = _rate_limited(values, slew * period_of(recording)), values
        changed = int(np.sum(values != ramped))
        left = float(np.std(values) / np.std(ramped)) if np.std(ramped) > 0 else 1.0
        if left < _LEAST_SWING:
            raise RecordingError(
                f"limited({name!r}): a slew of {slew:g} {unit}/s leaves {100 * left:.0f} % of the signal's swing; "
                "lower the amplitude or the frequencies, hold the bits longer, or allow a higher slew."
            )
        if changed:
            said.append(f"{changed} samples moved to keep the slew within {slew:g} {unit}/s")
    sentence = f"Limits of {name!r}: " + ("; ".join(said) if said else "kept without a change") + "."
    return with_signal(recording, name, values, signal.unit, sentence)


def _bound(voltage: float | None, duty: float | None, supply: float | None) -> tuple[float, str]:
    bounds = []
    if voltage is not None:
        positive("limited", voltage=voltage)
        bounds.append((voltage, f"voltage limit of {voltage:g}"))
    if duty is not None:
        if not 0 < duty <= 1:
            raise RecordingError(f"limited: duty is {duty!r}; give a share above 0 and at most 1, as in 0.95.")
        if supply is None:
            raise RecordingError("limited: a duty limit needs supply=, the voltage at a duty of 1.")
        positive("limited", supply=supply)
        bounds.append((duty * supply, f"duty limit of {duty:g} at {supply:g} V"))
    return min(bounds) if bounds else (np.inf, "")


def _rate_limited(values: np.ndarray, step: float) -> np.ndarray:
    """Values that follow within +-`step` from sample to sample, from 0."""
    result, last = np.empty_like(values), 0.0
    for k, wanted in enumerate(values.tolist()):
        last = min(max(wanted, last - step), last + step)
        result[k] = last
    return result
