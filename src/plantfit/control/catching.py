"""How far from an equilibrium a loop may begin and still return to it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import ClosedLoop, Observer

import jax
import jax.numpy as jnp

BATCH = 16  # starts on each side in a round


@dataclass(frozen=True)
class Caught:
    """Along a direction every start in [-low, high] that was tried was caught, and the next outward by `resolution` was
    not.

    `low`, `high` and `resolution` in units of the direction; `beyond` is True where nothing up to `largest` fell.
    """

    low: float
    high: float
    resolution: float
    low_beyond: bool
    high_beyond: bool


def largest_initial_angle(
    loop: ClosedLoop,
    controller: Any,
    plant: Mapping[str, Any],
    at: Mapping[str, float],
    along: Mapping[str, float],
    *,
    reference: Any = None,
    inputs: Mapping[str, Any] | None = None,
    largest: float = math.pi / 2,
    resolution: float = math.radians(0.1),
    seconds: float = 4.0,
    settled: float = 0.5,
    tolerance: float = math.radians(2.0),
) -> Caught:
    """How far the loop may begin from the state `at` in the directions -`along` and `along` (by name) and return there.

    A start is caught when every output that is a state stays within `tolerance` of `at` for the last `settled` of
    `seconds`. Both ways are searched at once, outward from `at` in batches of simulations, each of which narrows the
    bracket 16-fold, until it is at most `resolution` wide; a start that falls hides those farther out. `reference` and
    `inputs` as in `ClosedLoop.simulate` (reference {} if left out).

    Raises SimulationError for names or numbers that do not fit, and where the loop does not even hold `at` itself.
    """
    states = loop.parts.plant.vector.states
    names = [name for name in loop.parts.outputs if name in states]
    for name in {**at, **along}:
        if name not in states:
            raise SimulationError(f"The start names {name!r}; the plant has the states {list(states)}.")
    if not names or not any(along.values()):
        raise SimulationError(
            "No state is measured, or the direction is 0; measure a state and give a direction such as {'theta1': 1.0}."
        )
    if not (0 < resolution < largest and 0 < settled <= seconds and tolerance > 0):
        raise SimulationError(
            f"resolution = {resolution:g}, largest = {largest:g}, settled = {settled:g}, seconds = {seconds:g}, "
            f"tolerance = {tolerance:g}; "
            "give positive numbers, resolution below largest and settled at most seconds."
        )
    samples = round(seconds / loop.period)
    begin = (samples - round(settled / loop.period)) * loop.period
    watch = _farthest(tuple((name, float(at.get(name, 0.0))) for name in names), begin)

    def one(distance):
        x0 = {name: at.get(name, 0.0) + distance * along.get(name, 0.0) for name in states}
        return loop.observe(
            watch, controller, plant, {} if reference is None else reference, samples=samples, x0=x0, inputs=inputs
        )

    def caught(far: np.ndarray) -> np.ndarray:
        good = np.asarray(jax.vmap(one)(np.r_[0.0, far.ravel()])) <= tolerance  # nan is not caught
        if not good[0]:
            raise SimulationError(
                "The loop does not hold the state at which it begins; "
                "change the controller, or give more seconds or tolerance."
            )
        return good[1:].reshape(far.shape)

    return _outward(caught, float(largest), resolution)


def _outward(caught: Callable[[np.ndarray], np.ndarray], largest: float, resolution: float) -> Caught:
    """Both brackets between a start that is caught and the next that is not, narrowed in one batch a round."""
    inner, outer = np.zeros(2), np.full(2, largest)
    beyond: np.ndarray = np.zeros(2, dtype=bool)
    signs, first = np.array([[-1.0], [1.0]]), True
    while first or np.any((outer - inner > resolution) & ~beyond):
        far = inner[:, None] + (outer - inner)[:, None] * np.arange(1, BATCH + 1) / BATCH
        good = caught(signs * far)
        beyond, first = (np.all(good, axis=1) if first else beyond), False
        for k, row in enumerate(good):
            reached = BATCH if row.all() else int(np.argmin(row))
            ends = np.r_[inner[k], far[k], outer[k]]
            inner[k], outer[k] = ends[reached], ends[reached + 1]
    width = float(np.max(np.where(beyond, 0.0, outer - inner)))
    return Caught(float(inner[0]), float(inner[1]), width, bool(beyond[0]), bool(beyond[1]))


@lru_cache(maxsize=32)  # one identity per choice, so that loops compile once
def _farthest(at: tuple[tuple[str, float], ...], begin: float) -> Observer:
    """The largest deviation of the outputs named in `at` from time `begin` on; nan spreads."""

    def update(seen, t, y, u, reference):
        far = jnp.max(jnp.stack([jnp.abs((y[name] if isinstance(y, dict) else y) - value) for name, value in at]))
        return jnp.where(t >= begin, jnp.maximum(seen, far), seen)

    return Observer(lambda y, reference: jnp.asarray(0.0), update, lambda seen: seen)
