"""Pseudo-random binary sequences of maximum length from a linear feedback shift register."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.excitation.waveform import positive, samples, waveform
from plantfit.recording.record import Recording

# stages whose sum modulo 2 is fed back, counted from 1; primitive polynomials as listed in Xilinx XAPP052 (Alfke 1996),
# table 3
TAPS = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7),
    11: (11, 9),
    12: (12, 6, 4, 1), 13: (13, 4, 3, 1), 14: (14, 5, 3, 1), 15: (15, 14), 16: (16, 15, 13, 4), 17: (17, 14),
    18: (18, 11),
    19: (19, 6, 2, 1), 20: (20, 17),
}  # fmt: skip


def prbs(
    amplitude: float,
    rate: float,
    duration: float | None = None,
    *,
    order: int | None = None,
    hold: int = 1,
    seed: int = 0,
    offset: float = 0.0,
    signal: str = "V",
    unit: str | None = "V",
) -> Recording:
    """A binary signal between `offset` +- `amplitude`, `rate` samples a second, each bit held for `hold` samples.

    It repeats after (2^order - 1) bits. Left out, `order` is the smallest whose period fills
    `duration` (s); `duration` left out is one period. `seed` chooses where in the sequence it
    starts. Over whole periods of L bits its autocorrelation is amplitude^2 at lag 0 and
    -amplitude^2/L at all others. Raises RecordingError for what cannot be.

    Source: Ljung, System Identification (1999), section 13.3.
    """
    positive("prbs", amplitude=amplitude, rate=rate)
    if hold < 1 or hold != int(hold):
        raise RecordingError(f"prbs: hold is {hold!r}; give the samples of one bit, 1 or more.")
    if order is None:
        if duration is None:
            raise RecordingError("prbs: neither duration nor order is given; give one of them.")
        bits = -(-samples("prbs", rate, duration) // hold)
        order = next((n for n in TAPS if 2**n - 1 >= bits), max(TAPS))
    if order not in TAPS:
        raise RecordingError(f"prbs: order is {order!r}; choose from {min(TAPS)} to {max(TAPS)}.")
    length = 2**order - 1
    n = length * hold if duration is None else samples("prbs", rate, duration)
    start = int(np.random.default_rng(seed).integers(1, 2**order))
    bits = lfsr_bits(order, start, min(length, -(-n // hold)))
    values = offset + amplitude * (2.0 * np.resize(np.repeat(bits, hold), n) - 1.0)
    sentence = (
        f"PRBS of order {order} (period {length} bits, "
        f"{length * hold / rate:g} s), bits of {hold / rate:g} s, seed {seed}."
    )
    return waveform(values, rate, signal, unit, "prbs", sentence)


def lfsr_bits(order: int, state: int, count: int) -> np.ndarray:
    """`count` output bits (0 or 1) of the Fibonacci register with `TAPS[order]`, started at `state` (1 .. 2^order -
    1)."""
    shifts = [tap - 1 for tap in TAPS[order]]
    mask, bits = 2**order - 1, np.empty(count, dtype=np.int8)
    for k in range(count):
        bits[k] = state >> (order - 1)
        fed = 0
        for shift in shifts:
            fed ^= state >> shift
        state = ((state << 1) | (fed & 1)) & mask
    return bits
