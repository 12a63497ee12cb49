"""A problem as a search sees it: a cube and numbers."""

import numpy as np

from plantfit.optimize.contract import Objective
from plantfit.problem.problem import Problem


def objective_of(problem: Problem, start: np.ndarray | None = None) -> Objective:
    """The cost with its derivatives; `start` (k, d) are cube points to begin from, by default the guesses of the space."""
    if start is None and problem.space.start is not None:
        start = problem.space.start[None, :]
    return Objective(
        dimension=problem.space.dimension,
        costs=problem.costs,
        value_and_gradient=problem.value_and_gradient,
        residuals_and_jacobian=problem.residuals_and_jacobian,
        compressed=problem.compressed,
        separable=problem.separable,
        blocks=problem.separable_blocks,
        gradient_charge=problem.gradient_charge,
        jacobian_charge=problem.jacobian_charge,
        start=start,
        lower=problem.space.lower,
        upper=problem.space.upper,
    )
