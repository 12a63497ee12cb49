"""One local search from one point to its end, on any problem."""

import dataclasses
from dataclasses import dataclass
from functools import partial

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status
from plantfit.optimize.local.one_search import Loss, trust_region
from plantfit.optimize.local.separable import separable_least_squares
from plantfit.optimize.loop.counter import BudgetSpent, Counter
from plantfit.problem.evaluate import points
from plantfit.problem.problem import Problem
from plantfit.study.objective import objective_of
from plantfit.trust.intervals.linearised import EDGE

STEPS = 200  # Jacobians that one search may take
POLISH = 30  # Gauss-Newton steps after it


@dataclass(frozen=True)
class Descent:
    """Where a local search stands: point (d,), cost there, whether it came to its end, and the evaluations that it
    was charged."""

    z: np.ndarray
    cost: float
    ended: bool
    evaluations: float


def descent(problem: Problem, z: np.ndarray, evaluations: float | None = None) -> Descent:
    """Least squares from the cube point z (d,) alone, with no other start; at most so many `evaluations`, by default
    200 Jacobians."""
    z, objective = np.asarray(z, dtype=float), objective_of(problem, np.asarray(z, dtype=float)[None, :])
    objective = dataclasses.replace(objective, compressed=partial(points.compressed, problem))
    counter = Counter(objective, STEPS * problem.jacobian_charge if evaluations is None else evaluations)
    try:
        if objective.separable is not None:
            ended = separable_least_squares(counter, z, agree=1, max_steps=STEPS) is Status.converged
        else:
            trust_region(counter, z, Loss(), 10 * STEPS)  # the budget ends it sooner, and says so
            ended = True
    except BudgetSpent:
        ended = False
    z, cost = _newton(problem, counter.best_x if np.isfinite(counter.best_cost) else z, POLISH)
    return Descent(z, cost, ended and np.isfinite(cost), counter.spent)


def polished(problem: Problem, z: np.ndarray) -> Descent:
    """The last digits of a search that came to its end at z (d,)."""
    z, cost = _newton(problem, np.asarray(z, dtype=float), POLISH)
    return Descent(z, cost, bool(np.isfinite(cost)), 0.0)


def gauss_newton(problem: Problem, z: np.ndarray, most: int = POLISH) -> np.ndarray:
    """The last digits: Gauss-Newton steps of the coordinates inside the box, as long as each changes the residuals less
    than the last.

    A cost that is flat to rounding hides them from a search that compares costs, and the gradient is rounding there as
    well.
    """
    return _newton(problem, z, most)[0]


def _newton(problem: Problem, z: np.ndarray, most: int) -> tuple[np.ndarray, float]:
    """The point of `gauss_newton` and its cost."""
    residuals, jacobian = points.compressed(problem, z)
    before = np.inf
    for _ in range(most):
        inside = (z > EDGE) & (z < 1 - EDGE)
        if not np.any(inside) or not np.all(np.isfinite(jacobian)):
            break
        step = np.zeros_like(z)
        step[inside] = -np.linalg.lstsq(jacobian[:, inside], residuals, rcond=1e-12)[0]
        moved = np.clip(z + step, 0.0, 1.0)
        change = float(np.linalg.norm(jacobian @ (moved - z)))
        if change >= before or change == 0.0:
            break
        r, j = points.compressed(problem, moved)
        if not (np.all(np.isfinite(j)) and r @ r <= (1 + 1e-9) * (residuals @ residuals)):
            break
        z, residuals, jacobian, before = moved, r, j, change
    cost = float(np.mean(residuals**2))
    # derivatives that are no numbers make the few rows none, though the point can be simulated
    return z, cost if np.isfinite(cost) else float(problem.cost(z))
