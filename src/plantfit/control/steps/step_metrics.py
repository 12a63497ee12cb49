"""What a step response is judged by: one fold over its samples, for stored responses and inside a closed loop alike."""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from plantfit.errors import SimulationError
from plantfit.runtime import jit
from plantfit.simulate.loop.closed_loop import Observer

import jax.numpy as jnp
from jax import lax


class StepMetrics(NamedTuple):
    """Judgement of y going from its first value to the reference; times in seconds after the first sample.

    `overshoot` beyond the reference in percent of the step, 0 when there is none; `rise_time` from the
    first sample at or past `rise[0]` of the step to the first at or past `rise[1]`; `settling_time` of the
    first sample from which y stays inside the band; `peak_time` of the first largest value in the direction
    of the step; `steady_state_error` reference minus last value. What never happens takes inf seconds.
    """

    overshoot: Any
    rise_time: Any
    settling_time: Any
    peak_time: Any
    steady_state_error: Any


class _Seen(NamedTuple):
    begin: Any  # s
    sign: Any  # +1 for a step upwards, -1 downwards, 0 for none
    size: Any  # of the step, >= 0
    low: Any  # levels of the rise, times sign
    high: Any
    band: Any
    at_low: Any  # s
    at_high: Any
    settled: Any
    peak: Any  # times sign
    at_peak: Any
    last: Any
    reference: Any


def step_observer(band: float = 0.02, rise: tuple[float, float] = (0.1, 0.9)) -> Observer:
    """An observer for `ClosedLoop.observe` that gives `StepMetrics` of the plant's output against the first reference.

    `band` is half the width of the settling band and `rise` the levels of the rise, as shares of the step.
    Where the reference equals the first output there is no step: overshoot is nan.
    Raises SimulationError for a band or levels outside 0 .. 1.
    """
    if not 0 < band < 1:
        raise SimulationError(f"band = {band}; give a share of the step between 0 and 1, such as 0.02.")
    if not 0 <= rise[0] < rise[1] <= 1:
        raise SimulationError(f"rise = {rise}; give two increasing shares of the step, such as (0.1, 0.9).")
    return _observer(float(band), float(rise[0]), float(rise[1]))


def step_metrics(
    t: Any, y: Any, reference: Any, band: float = 0.02, rise: tuple[float, float] = (0.1, 0.9)
) -> StepMetrics:
    """`StepMetrics` of a stored response y (N,) at times t (N,) in seconds towards `reference`, a scalar.

    Raises SimulationError for shapes that differ, an empty response, or a reference equal to y[0].
    """
    t, y = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if t.ndim != 1 or t.shape != y.shape or not len(t):
        raise SimulationError(
            f"The step response has times {t.shape} and values {y.shape}; give two arrays of one length."
        )
    if np.ndim(reference) != 0:
        raise SimulationError(f"The reference has shape {np.shape(reference)}; a step has one final value.")
    if float(reference) == y[0]:
        raise SimulationError(f"The reference equals the first value, {y[0]:g}; there is no step to judge.")
    return StepMetrics(*map(float, _fold(step_observer(band, rise), t, y, float(reference))))


@partial(jit, static_argnums=0)
def _fold(observer: Observer, t, y, reference):
    def step(seen, row):
        return observer.update(seen, row[0], row[1], 0.0, reference), None

    return observer.result(lax.scan(step, observer.init(y[0], reference), (t, y))[0])


@lru_cache(maxsize=32)  # one identity per choice, so that loops compile once
def _observer(band: float, low: float, high: float) -> Observer:
    def init(y, reference):
        size = reference - y
        sign = jnp.sign(size)
        never = jnp.full_like(size, jnp.inf)
        return _Seen(
            never, sign, jnp.abs(size), sign * (y + low * size), sign * (y + high * size), band * jnp.abs(size),
            never, never, never, -never, never, y + 0.0 * size, reference + 0.0 * size,
        )  # fmt: skip

    def update(seen, t, y, u, reference):
        level = seen.sign * y
        higher = level > seen.peak
        # written so that nan is outside the band
        inside = jnp.abs(y - seen.reference) <= seen.band
        return seen._replace(
            begin=jnp.minimum(seen.begin, t),
            at_low=jnp.where(level >= seen.low, jnp.minimum(seen.at_low, t), seen.at_low),
            at_high=jnp.where(level >= seen.high, jnp.minimum(seen.at_high, t), seen.at_high),
            settled=jnp.where(inside, jnp.minimum(seen.settled, t), jnp.inf),
            peak=jnp.where(higher, level, seen.peak),
            at_peak=jnp.where(higher, t, seen.at_peak),
            last=y,
        )

    def result(seen):
        beyond = jnp.maximum(0.0, seen.peak - seen.sign * seen.reference)
        overshoot = jnp.where(seen.size > 0, 100.0 * beyond / jnp.where(seen.size > 0, seen.size, 1.0), jnp.nan)
        rise = jnp.where(jnp.isfinite(seen.at_high), seen.at_high - seen.at_low, jnp.inf)
        return StepMetrics(
            overshoot, rise, seen.settled - seen.begin, seen.at_peak - seen.begin, seen.reference - seen.last
        )

    return Observer(init, update, result)
