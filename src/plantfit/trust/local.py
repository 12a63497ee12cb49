"""A problem linearised at an answer: covariance, bounds that hold, directions that stay open."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.covariance import Block, covariance, effective_parameters, normal_matrix
from plantfit.trust.directions import Direction, flat_directions

import jax
import jax.numpy as jnp

EDGE = 1e-6  # of the cube: closer to a bound counts as on it
OPEN = 0.2  # of the cube: a value that may move so far unnoticed is not determined (see parameters._status)


@dataclass(frozen=True)
class Local:
    """The linearised problem at an answer: values and covariance (d,), (d, d) in the parameters' units.

    `effective` (d,) tells how far the data and not the box or a smoothing fix each value, 0 to 1; `touched` (d,) whether any
    residual depends on it at all.
    """

    values: np.ndarray
    covariance: np.ndarray
    standard_error: np.ndarray
    at_bound: tuple[str | None, ...]
    directions: tuple[Direction, ...]
    effective: np.ndarray
    touched: np.ndarray


def linearise(problem: Problem, z: np.ndarray) -> Local:
    """Covariance and flat directions at the cube point z (d,)."""
    space, blocks = problem.space, residual_blocks(problem)
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    smoothing = problem.smoothing.matrix if problem.smoothing else np.zeros((space.dimension,) * 2)
    bends = problem.smoothing.weighted(z) if problem.smoothing else (np.zeros(0), np.zeros((0, space.dimension)))
    lower, upper = _held(z, np.vstack([jacobian, bends[1]]), np.r_[residuals, bends[0]])
    free = ~(lower | upper)
    cube = covariance(jacobian, residuals, blocks, free, smoothing)
    values, slope = jax.jvp(space.physical, (jnp.asarray(z),), (jnp.ones(space.dimension),))
    values, slope = np.asarray(values), np.asarray(slope)
    physical = cube * slope[:, None] * slope[None, :]
    variance = float(residuals @ residuals) / max(1, len(residuals) - int(free.sum()))
    information = (normal_matrix(jacobian, blocks) + smoothing) / max(variance, 1e-300) / slope[:, None] / slope[None, :]
    on = np.flatnonzero(free)
    directions = flat_directions(
        information[np.ix_(on, on)], values[on], (space.upper - space.lower)[on], tuple(space.names[i] for i in on)
    )
    bound = tuple("lower" if a else "upper" if b else None for a, b in zip(lower, upper, strict=True))
    effective = effective_parameters(jacobian[:, on], blocks, smoothing[np.ix_(on, on)], variance)
    known = np.zeros(space.dimension)
    known[on] = effective
    return Local(
        values, physical, np.sqrt(np.maximum(np.diag(physical), 0.0)), bound, tuple(directions), known, np.any(jacobian != 0.0, axis=0)
    )


def _held(z: np.ndarray, jacobian: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (d,) that the data press onto their lower and upper bound.

    Where they could move inside by a fifth of the box and chi-squared would grow by less than 1, nothing presses: such a
    coordinate is open, and happens to stand on its bound.
    """
    gradient, curvature = jacobian.T @ residuals, np.sum(jacobian**2, axis=0)
    variance = max(float(residuals @ residuals) / max(1, len(residuals) - len(z)), 1e-300)
    pressed = 2.0 * OPEN * np.abs(gradient) + OPEN**2 * curvature >= variance
    return (z <= EDGE) & (gradient >= 0) & pressed, (z >= 1 - EDGE) & (gradient <= 0) & pressed


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Errors (m,) that samples share as whole numbers; samples without one get numbers of their own beyond."""
    unknown = np.isnan(numbers)
    last = np.max(numbers[~unknown], initial=0.0)
    return np.where(unknown, last + np.cumsum(unknown), numbers).astype(int)


def residual_blocks(problem: Problem) -> list[Block]:
    """Where the residuals of every output in every recording stand."""
    blocks, start = [], 0
    for name in problem.data["drive"]:
        for output in problem.outputs:
            index = problem.data["index"][name][output]
            if len(index):
                numbers = problem.experiments[name].error_numbers(output)
                blocks.append(Block(slice(start, start + len(index)), index if numbers is None else _whole(numbers[index])))
            start += len(index)
    return blocks
