"""Sine and square blocks, staircases and chirps."""

from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.excitation.waveform import below_nyquist, positive, samples, waveform
from plantfit.recording.record import Recording


def sine_square(
    amplitude: float,
    rate: float,
    duration: float,
    *,
    block: float = 20.0,
    frequency: float = 0.5,
    dead_zone: float = 0.0,
    signal: str = "V",
    unit: str | None = "V",
) -> Recording:
    """Blocks of a sine above zero, the same below zero, and a square wave of both signs, repeated to `duration` (s).

    A third each of `block` (s). The sines swing with `frequency` (Hz) between +-`dead_zone` and
    +-`amplitude`, so that the motor never stands still while it is asked to turn; the square wave
    jumps between +`amplitude` and -`amplitude` to show how the motor reverses.

    Source: the voltage block of a DC motor on a microcontroller (SYSTEMS.md B); its levels are not printed.
    """
    n = samples("sine_square", rate, duration)
    positive("sine_square", block=block)
    below_nyquist("sine_square", rate, frequency=frequency)
    _reaches("sine_square", amplitude, dead_zone)
    if block / 3 * frequency < 1:
        raise RecordingError(
            f"sine_square: a third of the block ({block / 3:g} s) is shorter than a swing at {frequency:g} Hz; "
            "lengthen the block or raise the frequency."
        )
    t = np.arange(n) / rate
    inside = np.mod(t + 0.5 / rate, block)  # half a sample, so that rounding never moves an edge
    part, local = np.minimum((3 * inside / block).astype(int), 2), np.mod(inside, block / 3) - 0.5 / rate
    sine = dead_zone + (amplitude - dead_zone) * (1 - np.cos(2 * np.pi * frequency * local)) / 2
    square = np.where(np.mod((local + 0.5 / rate) * frequency, 1.0) < 0.5, amplitude, -amplitude)
    values = np.choose(part, [sine, -sine, square])
    sentence = (
        f"Blocks of {block:g} s: sine above and below zero beyond ±{dead_zone:g}, square wave, at {frequency:g} Hz."
    )
    return waveform(values, rate, signal, unit, "sine_square", sentence)


def staircase(
    amplitude: float,
    rate: float,
    duration: float,
    *,
    steps: int = 6,
    dead_zone: float = 0.0,
    both_signs: bool = True,
    signal: str = "V",
    unit: str | None = "V",
) -> Recording:
    """Levels up to `amplitude` and down again, then the same below zero; all last equally long within `duration` (s).

    `steps` equal levels above `dead_zone`: dead_zone + k (amplitude - dead_zone)/steps, k = 1 .. steps,
    with a level of 0 before, between and after.
    """
    n = samples("staircase", rate, duration)
    if steps < 1:
        raise RecordingError(f"staircase: steps is {steps!r}; give 1 or more.")
    _reaches("staircase", amplitude, dead_zone)
    up = dead_zone + (amplitude - dead_zone) * np.arange(1, steps + 1) / steps
    hill = np.concatenate([[0.0], up, up[-2::-1]])
    levels = np.concatenate([hill, -hill, [0.0]]) if both_signs else np.concatenate([hill, [0.0]])
    if n < len(levels):
        raise RecordingError(
            f"staircase: {n} samples are fewer than the {len(levels)} levels; lengthen it or choose fewer steps."
        )
    values = levels[np.arange(n) * len(levels) // n]
    sentence = f"Staircase of {len(levels)} levels, {n / rate / len(levels):.4g} s each."
    return waveform(values, rate, signal, unit, "staircase", sentence)


def chirp(
    amplitude: float,
    rate: float,
    duration: float,
    *,
    low: float = 0.1,
    high: float = 5.0,
    sweep: Literal["linear", "logarithmic"] = "logarithmic",
    offset: float = 0.0,
    signal: str = "V",
    unit: str | None = "V",
) -> Recording:
    """A sine whose frequency runs from `low` to `high` (Hz) within `duration` (s), `offset` +- `amplitude`, starting
    at `offset`."""
    n = samples("chirp", rate, duration)
    positive("chirp", amplitude=amplitude)
    below_nyquist("chirp", rate, low=low, high=high)
    if sweep not in ("linear", "logarithmic"):
        raise RecordingError(f"chirp: sweep is {sweep!r}; use 'linear' or 'logarithmic'.")
    if low == high:
        raise RecordingError(f"chirp: low and high are both {low:g} Hz; give two frequencies.")
    t, total = np.arange(n) / rate, n / rate
    if sweep == "linear":
        turns = low * t + (high - low) * t**2 / (2 * total)
    else:
        growth = np.log(high / low)
        turns = low * total / growth * np.expm1(growth * t / total)
    values = offset + amplitude * np.sin(2 * np.pi * turns)
    return waveform(values, rate, signal, unit, "chirp", f"{sweep.capitalize()} chirp from {low:g} to {high:g} Hz.")


def _reaches(step: str, amplitude: float, dead_zone: float) -> None:
    """Refuse an amplitude that is not above 0 or not beyond the dead zone."""
    positive(step, amplitude=amplitude)
    if not 0 <= dead_zone < amplitude:
        raise RecordingError(
            f"{step}: dead_zone is {dead_zone:g}; choose from 0 up to the amplitude {amplitude:g}, without it."
        )
