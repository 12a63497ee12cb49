"""A problem as a search sees it: a cube and numbers."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Objective
from plantfit.problem.problem import Problem

import jax

SIDE_BY_SIDE = 500_000  # entries of a Jacobian of which several fit into memory at once


@lru_cache(maxsize=16)
def _batch(function: Callable) -> Callable:
    """Of one compiled function of (z, arguments) that for several z."""
    return jax.jit(jax.vmap(function, in_axes=(0, None)))


def objective_of(problem: Problem, start: np.ndarray | None = None) -> Objective:
    """The cost with its derivatives; `start` (k, d) are cube points to begin from, by default the guesses of the space."""
    if start is None and problem.space.start is not None:
        start = problem.space.start[None, :]

    def batch(zs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if regression:  # its one block has few rows, with the same mean square
            return _batch(problem.compiled["blocks"])(zs, problem.arguments)[0]
        return _batch(problem.compiled["residuals_and_jacobian"])(zs, problem.arguments)

    regression = "triangles" in problem.data
    samples = 0 if regression else sum(len(places) for outputs in problem.data["index"].values() for places in outputs.values())
    small = samples * problem.space.dimension <= SIDE_BY_SIDE
    return Objective(
        dimension=problem.space.dimension,
        costs=problem.costs,
        value_and_gradient=problem.value_and_gradient,
        residuals_and_jacobian=problem.residuals_and_jacobian,
        compressed=problem.compressed,
        batch_residuals_and_jacobian=batch if small else None,
        separable=problem.separable,
        blocks=problem.separable_blocks,
        gradient_charge=problem.gradient_charge,
        jacobian_charge=problem.jacobian_charge,
        start=start,
        lower=problem.space.lower,
        upper=problem.space.upper,
    )
