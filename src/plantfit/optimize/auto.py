"""What a user gets who chooses nothing."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.basins import Basins
from plantfit.optimize.batched_least_squares import WIDTH, side_by_side_least_squares
from plantfit.optimize.bipop import BipopCmaEs
from plantfit.optimize.cmaes import CmaEs
from plantfit.optimize.contract import Host, Needs, Objective, Population
from plantfit.optimize.counter import Counter
from plantfit.optimize.dd_cmaes import DecodingCmaEs
from plantfit.optimize.local import Found, Loss, lbfgsb, trust_region
from plantfit.optimize.separable import separable_least_squares
from plantfit.optimize.settings import integer, number
from plantfit.optimize.starts import far_apart, generator, sobol

from jax import Array

FEW_JACOBIANS = 25  # what one least-squares search takes, median of the problems in tests/optimize


class Rule(NamedTuple):
    """Without derivatives: the first rule whose `holds(dimension, budget)` is true names the method; `why` ends the sentence."""

    holds: Callable[[int, int], bool]
    method: Population | Host
    why: str


# Evidence. Many coordinates: section 5 of Hansen's tutorial, a full covariance learns in order d^2 evaluations, of which
# 100 d is the least that 100 coordinates can use. Few evaluations: restarts come after the first search has converged,
# which takes 100 to 1000 d evaluations (Hansen 2009, BBOB). Else: BIPOP was the best of 31 methods over all functions
# of BBOB-2009 beyond 100 d evaluations (Hansen, Auger, Ros, Finck and Posik 2010, GECCO companion, 1689).
RULES = (
    Rule(lambda d, _: d > 100, DecodingCmaEs(), "CMA-ES that learns scales before directions, because there are more than 100 parameters"),
    Rule(lambda d, budget: budget < 100 * d, CmaEs(), "CMA-ES, because the budget is below 100 evaluations for each parameter"),
    Rule(lambda d, budget: True, BipopCmaEs(), "CMA-ES with restarts of two kinds, because the budget has room for several searches"),
)


def by_residuals(objective: Objective, budget: int) -> bool:
    """Whether least squares is the local search: there are residuals, and the budget holds one search with their Jacobian."""
    if objective.residuals_and_jacobian is None:
        return False
    dear = budget < FEW_JACOBIANS * objective.jacobian_charge and objective.gradient_charge < objective.jacobian_charge
    return objective.value_and_gradient is None or not dear


@dataclass(frozen=True)
class Auto:
    """A spread sample, then local searches from its best points until the best answer repeats.

    With residuals the local search is least squares, with only a gradient, or a budget of few Jacobians, L-BFGS-B;
    without derivatives `choose` goes by RULES. Multi-start with a sampled global phase:
    Rinnooy Kan and Timmer 1987, Math. Programming 39:27.
    """

    needs: ClassVar[Needs] = Needs()
    share: float = number(0.15, 0.0, 0.9, "largest share of the budget for the sample before the local searches")
    agree: int = integer(3, 1, 1_000_000, "stop after so many independent starts ended in the best basin")
    searches: int = integer(5, 1, 1_000_000, "fewest local searches")
    max_steps: int = integer(200, 1, 1_000_000, "most steps of one local search")

    def choose(self, objective: Objective, budget: int) -> tuple[Population | Host, str]:
        """The method for what the objective offers and the budget allows, and a sentence that says why.

        By numbers that a resumed search sees again, never by the clock: what an evaluation takes shows in the budget.
        """
        if objective.separable is not None:
            why = "Least squares in which every recording searches on its own, because no two recordings share a free parameter."
            return self, why
        if by_residuals(objective, budget):
            return self, "Least squares from many starts, because the problem gives residuals with exact derivatives."
        if objective.residuals_and_jacobian is not None:
            return self, f"L-BFGS-B, because the budget holds fewer than {FEW_JACOBIANS} evaluations of all derivatives of the residuals."
        if objective.value_and_gradient is not None:
            return self, "L-BFGS-B from many starts, because the problem gives a gradient but no residuals."
        rule = next(r for r in RULES if r.holds(objective.dimension, budget))
        return rule.method, f"{rule.why}, and the problem gives costs without derivatives."

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        rng = generator(key)
        basins = Basins(counter.extra)
        points, costs = self._sample(objective, budget, counter, rng)
        finite = costs[np.isfinite(costs)]
        # a cost this far below the ordinary one is a perfect fit up to rounding
        basins.floor = 1e-14 * abs(float(np.median(finite))) if len(finite) else basins.floor
        if objective.separable is not None:
            start, _ = next(self._starts(objective, counter, points, costs, rng))
            separable_least_squares(counter, start, agree=self.agree, max_steps=2 * self.agree * self.max_steps)
            return Status.converged if counter.extra["basin_hits"] >= self.agree else Status.budget
        starts = self._starts(objective, counter, points, costs, rng)
        if by_residuals(objective, budget) and objective.batch_residuals_and_jacobian is not None:
            side_by_side_least_squares(
                counter, starts, basins, width=WIDTH, agree=self.agree, searches=self.searches, max_steps=self.max_steps
            )
            return Status.converged
        for start, independent in starts:
            basins.add(self._search(objective, counter, start, budget), independent)
            if basins.hits >= self.agree and basins.searches >= self.searches:
                return Status.converged
        return Status.budget

    def _sample(self, objective: Objective, budget: int, counter: Counter, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        n = int(min(max(64, 16 * objective.dimension), self.share * budget))
        points = sobol(n, objective.dimension, rng) if n else np.zeros((0, objective.dimension))
        return points, counter.costs(points) if n else np.zeros(0)

    def _search(self, objective: Objective, counter: Counter, start: np.ndarray, budget: int) -> Found:
        if by_residuals(objective, budget):
            return trust_region(counter, start, Loss(), self.max_steps)
        return lbfgsb(counter, start, self.max_steps)

    def _starts(
        self, objective: Objective, counter: Counter, points: np.ndarray, costs: np.ndarray, rng: np.random.Generator
    ) -> Iterator[tuple[np.ndarray, bool]]:
        """Starts and whether they are independent: best sample, warm starts, further spread samples, then in
        turn the next sample, a step away from the best point, a uniform point."""
        spread, rest = far_apart(points, costs)
        warm = [] if objective.start is None else list(np.clip(np.asarray(objective.start, dtype=float), 0.0, 1.0))
        first = [points[i] for i in spread[: self.searches]]
        yield from ((x, True) for x in [*first[:1], *warm, *first[1:]])
        later = iter([*spread[self.searches :], *rest])
        while True:
            following = next(later, None)
            if following is not None:
                yield points[following], True
            if np.isfinite(counter.best_cost):
                width = 10 ** rng.uniform(-2, -0.5)
                yield np.clip(counter.best_x + width * rng.standard_normal(objective.dimension), 0.0, 1.0), False
            yield rng.random(objective.dimension), True
