"""Small objectives with known answers and derivatives, for the conformance suites."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Objective

import jax
import jax.numpy as jnp
from jax import Array

OUTSIDE = -1e6  # what a candidate outside the cube costs: a prize, so that leaving shows


def from_residuals(residuals: Callable[[Array], Any], dimension: int) -> Objective:
    """An objective with every derivative, from one function of a cube point (d,) to residuals (m,)."""

    def costs(x: Array) -> Array:
        inside = jnp.all((x >= 0) & (x <= 1), axis=1)
        return jnp.where(inside, jnp.mean(jax.vmap(residuals)(x) ** 2, axis=1), OUTSIDE)

    def cost(x: Array) -> Array:
        return costs(x[None])[0]

    gradient = jax.jit(jax.value_and_grad(cost))
    both = jax.jit(lambda x: (residuals(x), jax.jacfwd(residuals)(x)))
    box = np.ones(dimension)  # for methods that read bounds in units
    return Objective(dimension, costs, gradient, both, lower=-box, upper=box)


def centre(dimension: int) -> np.ndarray:
    """Optimum of `bowl`: uneven and off the middle."""
    return 0.15 + 0.6 * ((np.arange(dimension) * 0.618034) % 1.0)


@lru_cache(maxsize=16)
def bowl(dimension: int, moved: float = 0.0, turned: bool = False) -> Objective:
    """A well-conditioned bowl with its optimum, cost 0, at `centre + moved`; `turned` reverses the coordinates."""
    weights = np.linspace(1.0, 3.0, dimension)
    target = centre(dimension) + moved

    def residuals(x: Array) -> Array:
        z = x[::-1] if turned else x
        return jnp.asarray(weights) * (z - target)

    return from_residuals(residuals, dimension)


@lru_cache(maxsize=16)
def corner(dimension: int) -> Objective:
    """The optimum is the corner 1, 0, 1, ... of the cube, cost 0.01; where the first coordinate is below 0.5
    nothing can be simulated."""
    pull = np.where(np.arange(dimension) % 2 == 0, 1.1, -0.1)

    def residuals(x: Array) -> Array:
        return jnp.where(x[0] < 0.5, jnp.nan, x - pull)

    return from_residuals(residuals, dimension)


@lru_cache(maxsize=16)
def flat(dimension: int) -> Objective:
    """The same cost, 1, everywhere."""
    return from_residuals(lambda x: jnp.ones(3) + 0.0 * jnp.sum(x), dimension)


@lru_cache(maxsize=16)
def hopeless(dimension: int) -> Objective:
    """No candidate can be simulated."""
    return from_residuals(lambda x: x * jnp.nan, dimension)
