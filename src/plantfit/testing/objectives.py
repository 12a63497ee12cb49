"""Small objectives with known answers and derivatives, for the conformance suites."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import CostOfData, Objective

import jax
import jax.numpy as jnp
from jax import Array

OUTSIDE = -1e6  # what a candidate outside the cube costs: a prize, so that leaving shows


def from_residuals(residuals: Callable[[Array], Any], dimension: int) -> Objective:
    """An objective with every derivative, from one function of a cube point (d,) to residuals (m,)."""

    def costs(x: Array) -> Array:
        return _mean_squares(residuals, x)

    def cost(x: Array) -> Array:
        return costs(x[None])[0]

    gradient = jax.jit(jax.value_and_grad(cost))
    both = jax.jit(lambda x: (residuals(x), jax.jacfwd(residuals)(x)))
    box = np.ones(dimension)  # for methods that read bounds in units
    return Objective(dimension, costs, gradient, both, lower=-box, upper=box)


def _mean_squares(residuals: Callable[[Array], Any], x: Array) -> Array:
    inside = jnp.all((x >= 0) & (x <= 1), axis=1)
    return jnp.where(inside, jnp.mean(jax.vmap(residuals)(x) ** 2, axis=1), OUTSIDE)


class Shape(NamedTuple):
    """Residuals of a cube point as numbers: weights * (x[order] - target), and nothing works where the first
    coordinate is below `wall`."""

    weights: np.ndarray
    target: np.ndarray
    order: np.ndarray
    wall: float = -np.inf


def _residuals(x: Array, shape: Shape) -> Array:
    return jnp.where(
        x[0] < shape.wall, jnp.nan, jnp.asarray(shape.weights) * (x[jnp.asarray(shape.order)] - shape.target)
    )


def _costs(x: Array, shape: Shape) -> Array:
    return _mean_squares(partial(_residuals, shape=shape), x)


_gradient = jax.jit(jax.value_and_grad(lambda x, shape: _costs(x[None], shape)[0]))
_both = jax.jit(lambda x, shape: (_residuals(x, shape), jax.jacfwd(_residuals)(x, shape)))


def _of_shape(shape: Shape) -> Objective:
    """An objective with every derivative; all of one dimension share their compiled programs, which take most of an
    exam."""
    box = np.ones(len(shape.target))
    whole = partial(_gradient, shape=shape), partial(_both, shape=shape)
    return Objective(len(box), CostOfData(_costs, shape), *whole, lower=-box, upper=box)


def centre(dimension: int) -> np.ndarray:
    """Optimum of `bowl`: uneven and off the middle."""
    return 0.15 + 0.6 * ((np.arange(dimension) * 0.618034) % 1.0)


@lru_cache(maxsize=16)
def bowl(dimension: int, moved: float = 0.0, turned: bool = False) -> Objective:
    """A well-conditioned bowl with its optimum, cost 0, at `centre + moved`; `turned` reverses the coordinates."""
    order = np.arange(dimension)
    return _of_shape(
        Shape(np.linspace(1.0, 3.0, dimension), centre(dimension) + moved, order[::-1] if turned else order)
    )


@lru_cache(maxsize=16)
def corner(dimension: int) -> Objective:
    """The optimum is the corner 1, 0, 1, ... of the cube, cost 0.01; where the first coordinate is below 0.5
    nothing can be simulated."""
    order = np.arange(dimension)
    return _of_shape(Shape(np.ones(dimension), np.where(order % 2 == 0, 1.1, -0.1), order, 0.5))


@lru_cache(maxsize=16)
def flat(dimension: int) -> Objective:
    """The same cost, 1, everywhere."""
    return from_residuals(lambda x: jnp.ones(3) + 0.0 * jnp.sum(x), dimension)


@lru_cache(maxsize=16)
def hopeless(dimension: int) -> Objective:
    """No candidate can be simulated."""
    return _of_shape(Shape(np.ones(dimension), np.full(dimension, np.nan), np.arange(dimension)))
