"""Crest factor and amplitude spectrum of a waveform."""

import numpy as np


def crest_factor(values: np.ndarray) -> float:
    """Peak over root mean square of values (n,); 1 for a square wave, sqrt(2) for a sine."""
    return float(np.max(np.abs(values)) / np.sqrt(np.mean(np.square(values))))


def amplitude_spectrum(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and amplitudes of the sines that make up values (n,) sampled at `rate` (Hz); no window."""
    n = len(values)
    amplitudes = np.abs(np.fft.rfft(values)) * 2 / n
    amplitudes[0] /= 2
    if n % 2 == 0:
        amplitudes[-1] /= 2
    return np.fft.rfftfreq(n, 1 / rate), amplitudes
