"""Medians of calls that take turns, so that a busy machine slows all of them alike."""

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax


class Timing(NamedTuple):
    """Seconds: the first call, which may compile; the medians of the later ones in wall-clock and in this process's
    CPU time."""

    first: float
    median: float
    cpu: float


def interleaved(calls: Mapping[str, Callable[[], Any]], repeats: int, at_least: float = 0.05) -> dict[str, Timing]:
    """Time every call `repeats` times in turn; short ones are repeated inside each turn until `at_least` seconds are
    filled.

    The first of such a turn is not counted, as the calls of a search follow one another with their data at hand.
    """
    first, inner = {}, {}
    for label, call in calls.items():
        first[label], _ = _measure(call, 1)
        inner[label] = max(1, int(at_least / max(1e-9, _measure(call, 1)[0])))
    turns = [{label: _measure(call, inner[label]) for label, call in calls.items()} for _ in range(repeats)]
    return {
        label: Timing(first[label], *(sorted(turn[label][i] for turn in turns)[repeats // 2] for i in (0, 1)))
        for label in calls
    }


def _measure(call: Callable[[], Any], times: int) -> tuple[float, float]:
    """Wall and CPU seconds of one call, averaged over `times`."""
    if times > 1:
        jax.block_until_ready(call())
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(times):
        jax.block_until_ready(call())
    return (time.perf_counter() - wall) / times, (time.process_time() - cpu) / times
