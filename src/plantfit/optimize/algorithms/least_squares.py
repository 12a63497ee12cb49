"""Multi-start trust-region least squares."""

from dataclasses import dataclass
from typing import ClassVar

from plantfit.errors import Status
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import Loss, trust_region
from plantfit.optimize.local.separable import separable_least_squares
from plantfit.optimize.local.side_by_side import WIDTH, LocalSearches, Start, one_after_another, project, solved_at_once
from plantfit.optimize.local.starts import generator, warm_then_uniform
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import choice, integer, number

from jax import Array


@dataclass(frozen=True)
class LeastSquares:
    """Trust-region reflective least squares with the exact Jacobian from the warm starts, then from
    uniform points, until the best basin was found `agree` times or the budget is spent
    (Branch, Coleman and Li 1999, SIAM J. Sci. Comput. 21:1, as in scipy.optimize.least_squares).

    Where the objective evaluates several Jacobians at once, searches run side by side (Levenberg-Marquardt with
    projected steps): 10 times less CPU time in problems of 2 to 30 parameters and up to 1000 samples, in which the
    arithmetic of one search costs more than the model, 2 times less at 20 000 samples. Parameters in which the
    residuals are affine are then solved for at every point (`Objective.projected`).

    A robust loss decides which point is best; the cost reported with it stays mean(residuals**2), so
    that its history need not fall.
    """

    needs: ClassVar[Needs] = Needs(residuals=True)
    agree: int = integer(5, 1, 1_000_000, "stop after so many starts ended in the best basin")
    loss: str = choice("linear", ("linear", "soft_l1", "huber", "cauchy"), "robust losses give outliers less weight")
    f_scale: float = number(1.0, 1e-300, 1e300, "residual at which a robust loss begins to differ from least squares")
    max_steps: int = integer(200, 1, 1_000_000, "most steps of one local search")
    solve_linear: str = choice(
        "yes", ("yes", "no"), "solve for parameters in which the outputs are affine at every point"
    )
    side_by_side: int = integer(
        WIDTH, 1, 1000, "searches whose steps are evaluated together, for plain least squares of moderate size"
    )

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        loss = Loss(self.loss, self.f_scale)
        if self.loss != "linear":
            counter.rank = loss.rank
        basins = Basins(counter.extra)
        warm = 0 if objective.start is None else len(objective.start)
        starts = warm_then_uniform(objective.start, objective.dimension, generator(key))
        if self._together(objective, counter):
            if solved_at_once(counter, basins):
                return Status.converged
            marked = (Start(x, asked=k < warm) for k, x in enumerate(starts))
            return LocalSearches(counter, marked, basins, self.agree, self.max_steps, width=self.side_by_side).run()
        if objective.separable is not None and self.loss == "linear":
            return separable_least_squares(
                counter, next(starts), agree=self.agree, max_steps=2 * self.agree * self.max_steps
            )
        return one_after_another(
            counter,
            (Start(x, asked=k < warm) for k, x in enumerate(starts)),
            lambda x, steps: trust_region(counter, x, loss, steps),
            basins,
            agree=self.agree,
            max_steps=self.max_steps,
        )

    def _together(self, objective: Objective, counter: Counter) -> bool:
        if self.loss != "linear" or self.side_by_side == 1 or objective.separable is not None:
            return False
        return project(counter, self.solve_linear) or objective.batch_rows is not None
