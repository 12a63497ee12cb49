"""Sums of sines of equal amplitude whose phases keep the peak low."""

from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.excitation.spectrum import crest_factor
from plantfit.recording.excitation.waveform import below_nyquist, positive, samples, waveform
from plantfit.recording.record import Recording

_CLIP_FROM, _CLIP_TO = 0.75, 0.999  # of the peak, over the iterations
Phases = Literal["crest", "schroeder", "random"]


def multisine(
    amplitude: float,
    rate: float,
    period: float,
    *,
    low: float | None = None,
    high: float | None = None,
    periods: int = 1,
    odd: bool = False,
    phases: Phases = "crest",
    seed: int = 0,
    offset: float = 0.0,
    signal: str = "V",
    unit: str | None = "V",
) -> Recording:
    """Sines at all multiples of 1/`period` from `low` to `high` (Hz), scaled so that the peak is `amplitude`.

    `periods` of them, `offset` added. `low` left out is 1/period, `high` is rate/5. With `odd`
    only odd multiples, which leaves the even ones free to show nonlinearity. `phases`: "crest"
    (Schroeder's, then optimised), "schroeder", or "random" from `seed`.

    Sources: Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85, for a flat spectrum; Van der Ouderaa,
    Schoukens, Renneboog, IEEE Trans. Instrum. Meas. 37 (1988) 145: clip, keep the phases, restore the amplitudes.
    """
    positive("multisine", amplitude=amplitude, periods=periods)
    n = samples("multisine", rate, period)
    low, high = 1 / period if low is None else low, rate / 5 if high is None else high
    below_nyquist("multisine", rate, low=low, high=high)
    multiples = np.arange(
        max(1, int(np.ceil(low * n / rate - 1e-9))), min((n - 1) // 2, int(np.floor(high * n / rate + 1e-9))) + 1
    )
    multiples = multiples[multiples % 2 == 1] if odd else multiples
    if len(multiples) == 0:
        raise RecordingError(
            f"multisine: no multiple of 1/period = {rate / n:g} Hz lies from "
            f"{low:g} to {high:g} Hz; lengthen the period or widen the band."
        )
    if phases not in ("crest", "schroeder", "random"):
        raise RecordingError(f"multisine: phases is {phases!r}; use 'crest', 'schroeder' or 'random'.")
    angles = (
        np.random.default_rng(seed).uniform(0, 2 * np.pi, len(multiples))
        if phases == "random"
        else schroeder_phases(len(multiples))
    )
    if phases == "crest":
        angles = lower_crest(multiples, angles, n)
    wave = _sum(multiples, angles, n)
    values = offset + amplitude * np.tile(wave / np.max(np.abs(wave)), int(periods))
    kind = f"{phases} phases, seed {seed}" if phases == "random" else f"{phases} phases"
    sentence = (
        f"Multisine of {len(multiples)} lines from {multiples[0] * rate / n:g} to {multiples[-1] * rate / n:g} Hz, "
        f"period {n / rate:g} s, "
        f"{kind}, crest factor {crest_factor(wave):.3f}."
    )
    return waveform(values, rate, signal, unit, "multisine", sentence)


def schroeder_phases(count: int) -> np.ndarray:
    """Phases (count,) in rad of Schroeder's rule for lines of equal power: -pi k (k - 1)/count, k = 1 .. count."""
    k = np.arange(1, count + 1)
    return -np.pi * k * (k - 1) / count


def lower_crest(multiples: np.ndarray, phases: np.ndarray, n: int, iterations: int = 2000) -> np.ndarray:
    """Phases (rad) of cosines at `multiples` of the fundamental, n samples a period, with a lower crest factor than
    `phases`."""
    best, lowest = phases, np.inf
    for clip in np.linspace(_CLIP_FROM, _CLIP_TO, iterations):
        wave = _sum(multiples, phases, n)
        crest = crest_factor(wave)
        if crest < lowest:
            best, lowest = phases, crest
        limit = clip * np.max(np.abs(wave))
        phases = np.angle(np.fft.rfft(np.clip(wave, -limit, limit))[multiples])
    return best


def _sum(multiples: np.ndarray, phases: np.ndarray, n: int) -> np.ndarray:
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    spectrum[multiples] = np.exp(1j * phases)
    return np.fft.irfft(spectrum, n) * n / 2
