"""Step, PRBS, multisine and chirp of many settings, each between -1 and 1: what a designed input is held against."""

from collections.abc import Iterator

import numpy as np

from plantfit.recording.excitation.multisine import lower_crest, schroeder_phases
from plantfit.recording.excitation.prbs import prbs

BITS = (8, 16, 32, 64, 128, 256)  # of a PRBS, in the time of the recording
TURNS = (2, 4, 8, 16, 32, 64)  # of the fastest sine, in the time of the recording
LINES = 48  # of a multisine, at most


def shapes(n: int, inputs: int, seed: int, hold: int = 1) -> Iterator[tuple[str, np.ndarray]]:
    """Kinds with settings, and their values (n, inputs), each of which lasts for `hold` samples at least (but at the
    end)."""
    held = np.arange(n) // hold * hold
    for name, values in _shapes(n, inputs, seed, hold):
        yield name, values if name.startswith(("step", "PRBS")) else values[held]


def _shapes(n: int, inputs: int, seed: int, least: int) -> Iterator[tuple[str, np.ndarray]]:
    places = (1 + np.arange(inputs)) / (inputs + 1)
    yield "step", np.column_stack([np.where(np.arange(n) < max(1, int(p * n * 0.2)), -1.0, 1.0) for p in places])
    yield "step", np.column_stack([np.where(np.arange(n) < max(1, int(p * n)), -1.0, 1.0) for p in places])
    for bits in (b for b in BITS if 2 * b <= n):
        hold = max(1, round(n / bits))
        if hold < least:
            continue
        found = [prbs(1.0, 1.0, float(n), hold=hold, seed=seed + 7 * k)["V"] for k in range(inputs)]
        yield f"PRBS with bits of {hold} samples", np.column_stack(found)
    for turns in (k for k in TURNS if 4 * k <= n):
        found = []
        for k in range(inputs):
            multiples = np.unique(np.linspace(1, turns, min(turns, LINES)).astype(int))
            angles = np.roll(schroeder_phases(len(multiples)), k)
            angles = lower_crest(multiples, angles + 1.7 * k, n) if len(multiples) > 1 else angles
            wave = np.sum(np.cos(2 * np.pi * np.arange(n)[:, None] * multiples / n + angles), axis=1)
            found.append(wave / np.max(np.abs(wave)))
        yield f"multisine up to {turns} periods", np.column_stack(found)
        t = np.arange(n) / n
        growth = np.log(2.0 * turns)
        sweep = np.sin(2 * np.pi * 0.5 / growth * np.expm1(growth * t))
        yield (
            f"chirp up to {turns} periods",
            np.column_stack([sweep if k % 2 == 0 else sweep[::-1] for k in range(inputs)]),
        )


def kind_of(name: str) -> str:
    """The kind of a shape without its settings."""
    return name.split(" ")[0]
