"""Medians of repeated calls."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax


class Timing(NamedTuple):
    """Seconds: the first call, which compiles, and the median of the later ones."""

    first: float
    median: float


def timed(call: Callable[[], Any], repeats: int, at_least: float = 0.02) -> Timing:
    """Time `call`; short ones are repeated inside each of the `repeats` measurements until `at_least` seconds are
    filled."""
    started = time.perf_counter()
    jax.block_until_ready(call())
    first = time.perf_counter() - started
    started = time.perf_counter()
    jax.block_until_ready(call())
    inner = max(1, int(at_least / max(1e-9, time.perf_counter() - started)))
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        for _ in range(inner):
            jax.block_until_ready(call())
        seconds.append((time.perf_counter() - started) / inner)
    return Timing(first, sorted(seconds)[repeats // 2])
