"""How far from an equilibrium a loop may begin and still return to it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.closed_loop import ClosedLoop, Observer

import jax
import jax.numpy as jnp


@dataclass(frozen=True)
class Caught:
    """Along a direction every start in [-low, high] that was tried was caught, and the next outward by `resolution` was not.

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
        raise SimulationError("No state is measured, or the direction is 0; measure a state and give a direction such as {'theta1': 1.0}.")
    if not (0 < resolution < largest and 0 < settled <= seconds and tolerance > 0):
        raise SimulationError(
            f"resolution = {resolution:g}, largest = {largest:g}, settled = {settled:g}, seconds = {seconds:g}, tolerance = {tolerance:g}; "
            "give positive numbers, resolution below largest and settled at most seconds."
        )
    samples = round(seconds / loop.period)
    watch = _farthest({name: float(at.get(name, 0.0)) for name in names}, (samples - round(settled / loop.period)) * loop.period)

    @jax.jit
    def caught(far):
        def one(distance):
            x0 = {name: at.get(name, 0.0) + distance * along.get(name, 0.0) for name in states}
            return loop.observe(watch, controller, plant, {} if reference is None else reference, samples=samples, x0=x0, inputs=inputs)

        return jax.vmap(one)(far) <= tolerance  # nan is not caught

    if not caught(jnp.zeros(1))[0]:
        raise SimulationError(
            "The loop does not hold the state it is to return to; mend the controller, or give more seconds or tolerance."
        )
    inner, outer = np.zeros(2), np.full(2, float(largest))
    beyond = np.zeros(2, dtype=bool)
    signs, parts, first = np.array([-1.0, 1.0]), np.arange(1, 17) / 16.0, True
    while first or np.any((outer - inner > resolution) & ~beyond):
        far = inner[:, None] + (outer - inner)[:, None] * parts
        good = np.asarray(caught(jnp.asarray((signs[:, None] * far).ravel()))).reshape(2, 16)
        beyond, first = np.where(first, good.all(axis=1), beyond), False
        for k in range(2):
            reached = 16 if good[k].all() else int(np.argmin(good[k]))
            at_most = far[k, reached] if reached < 16 else outer[k]
            inner[k], outer[k] = (far[k, reached - 1] if reached else inner[k]), at_most
    widths = np.where(beyond, 0.0, outer - inner)
    return Caught(float(inner[0]), float(inner[1]), float(widths.max()), bool(beyond[0]), bool(beyond[1]))


def _farthest(at: Mapping[str, float], begin: float) -> Observer:
    """The largest deviation of the outputs named in `at` from time `begin` on; nan spreads."""

    def update(seen, t, y, u, reference):
        far = jnp.max(jnp.stack([jnp.abs(y[name] - value) for name, value in at.items()]))
        return jnp.where(t >= begin, jnp.maximum(seen, far), seen)

    return Observer(lambda y, reference: jnp.asarray(0.0), update, lambda seen: seen)
