"""What a user gets who chooses nothing."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar, NamedTuple

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.algorithms.cma_es.bipop import BipopCmaEs
from plantfit.optimize.algorithms.cma_es.cmaes import CmaEs
from plantfit.optimize.algorithms.cma_es.dd_cmaes import DecodingCmaEs
from plantfit.optimize.contract import Host, Needs, Objective, Population
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import Found, Loss, lbfgsb, trust_region
from plantfit.optimize.local.separable import separable_least_squares
from plantfit.optimize.local.side_by_side import LocalSearches, Start, one_after_another, project, solved_at_once
from plantfit.optimize.local.starts import CHUNK, Spread, far_apart, generator, sobol
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import choice, integer, number

from jax import Array

# cost of a perfect fit by least squares, and by a gradient, as a share of the sample's median cost
PERFECT, NEARLY = (1e-20, 1e-14)
PIECE = 64  # points of a sample that are evaluated in one go
FEW_JACOBIANS = 25  # what one least-squares search takes, median of the problems in tests/optimize


class Rule(NamedTuple):
    """Without derivatives: the first rule whose `holds(dimension, budget)` is true names the method; `why` ends the
    sentence."""

    holds: Callable[[int, int], bool]
    method: Population | Host
    why: str


# Evidence. Many coordinates: section 5 of Hansen's tutorial, a full covariance learns in order d^2 evaluations, of
# which 100 d is the least that 100 coordinates can use. Few evaluations: restarts come after the first search has
# converged, which takes 100 to 1000 d evaluations (Hansen 2009, BBOB). Else: BIPOP was the best of 31 methods over all
# functions of BBOB-2009 beyond 100 d evaluations (Hansen, Auger, Ros, Finck and Posik 2010, GECCO companion, 1689).
RULES = (
    Rule(
        lambda d, _: d > 100,
        DecodingCmaEs(),
        "CMA-ES that learns scales before directions, because there are more than 100 parameters",
    ),
    Rule(
        lambda d, budget: budget < 100 * d,
        CmaEs(),
        "CMA-ES, because the budget is below 100 evaluations for each parameter",
    ),
    Rule(
        lambda d, budget: True,
        BipopCmaEs(),
        "CMA-ES with restarts of two kinds, because the budget has room for several searches",
    ),
)


def by_residuals(objective: Objective, budget: int) -> bool:
    """Whether least squares is the local search: there are residuals, and the budget holds one search with their
    Jacobian."""
    if objective.residuals_and_jacobian is None:
        return False
    dear = budget < FEW_JACOBIANS * objective.jacobian_charge and objective.gradient_charge < objective.jacobian_charge
    return objective.value_and_gradient is None or not dear


@dataclass(frozen=True)
class Auto:
    """A spread sample, then local searches from its best points until the best answer repeats and little of the box is
    unseen.

    With residuals the local search is least squares, with only a gradient, or a budget of few Jacobians, L-BFGS-B;
    without derivatives `choose` goes by RULES. Multi-start with a sampled global phase:
    Rinnooy Kan and Timmer 1987, Math. Programming 39:27.
    """

    needs: ClassVar[Needs] = Needs()
    share: float = number(0.15, 0.0, 0.9, "largest share of the budget for the sample before the local searches")
    second: float = number(
        0.2, 0.0, 0.9, "share of the budget for a second sample, where least-squares searches end in several optima"
    )
    agree: int = integer(3, 1, 1_000_000, "stop after so many independent starts ended in the best basin")
    searches: int = integer(8, 1, 1_000_000, "fewest local searches")
    unseen: float = number(
        0.02, 1e-6, 1.0, "stop only when at most this share of the box is expected to lead to optima not seen yet"
    )
    solve_linear: str = choice(
        "yes", ("yes", "no"), "solve for parameters in which the outputs are affine at every point"
    )
    max_steps: int = integer(200, 1, 1_000_000, "most steps of one local search")

    def choose(self, objective: Objective, budget: int) -> tuple[Population | Host, str]:
        """The method for what the objective offers and the budget allows, and a sentence that says why.

        By numbers that a resumed search sees again, never by the clock: what an evaluation takes shows in the budget.
        """
        if objective.separable is not None:
            why = (
                "Least squares in which every recording searches on its "
                "own, because no two recordings share a free parameter."
            )
            return self, why
        if by_residuals(objective, budget):
            return self, "Least squares from many starts, because the problem gives residuals with exact derivatives."
        if objective.residuals_and_jacobian is not None:
            return (
                self,
                f"L-BFGS-B, because the budget holds fewer than {FEW_JACOBIANS} "
                "evaluations of all derivatives of the residuals.",
            )
        if objective.value_and_gradient is not None:
            return self, "L-BFGS-B from many starts, because the problem gives a gradient but no residuals."
        rule = next(r for r in RULES if r.holds(objective.dimension, budget))
        return rule.method, f"{rule.why}, and the problem gives costs without derivatives."

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        rng = generator(key)
        basins = Basins(counter.extra)
        least_squares = by_residuals(objective, budget) and objective.separable is None
        together = least_squares and (project(counter, self.solve_linear) or objective.batch_rows is not None)
        if together and solved_at_once(counter, basins):
            return Status.converged
        spread = Spread.of(objective)
        points, costs = self._sample(objective, self.share * budget, counter, spread, rng)
        finite = costs[np.isfinite(costs)]
        # a cost this far below the ordinary one is a perfect fit up to rounding
        basins.floor = (
            (PERFECT if together else NEARLY) * abs(float(np.median(finite))) if len(finite) else basins.floor
        )
        starts = self._starts(objective, budget, counter, basins, spread, points, costs, rng, together)
        if objective.separable is not None:
            return separable_least_squares(
                counter, next(starts).x, agree=self.agree, max_steps=2 * self.agree * self.max_steps
            )
        limits = {"agree": self.agree, "searches": self.searches, "unseen": self.unseen, "max_steps": self.max_steps}
        if together:
            return LocalSearches(counter, starts, basins, **limits).run()
        return one_after_another(
            counter, starts, lambda x, steps: self._search(objective, counter, x, budget, steps), basins, **limits
        )

    def _sample(
        self,
        objective: Objective,
        allowed: float,
        counter: Counter,
        spread: Spread,
        rng: np.random.Generator,
        *,
        large: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Spread points (n, d) and their costs (n,); with the affine parameters solved for where the search does so."""
        projected = counter.projected
        dimension = objective.dimension if projected is None else len(projected.kept)
        price = 1.0 if projected is None else projected.cost_charge
        n = int(allowed / price if large else min(max(64, 16 * dimension), allowed / price))
        if not n:
            return np.zeros((0, objective.dimension)), np.zeros(0)
        points = spread.points(sobol(n, objective.dimension, rng), rng)
        # piece by piece, so that a stop is seen and progress told in between
        return points, np.concatenate([self._costs(counter, points[i : i + PIECE]) for i in range(0, n, PIECE)])

    @staticmethod
    def _costs(counter: Counter, points: np.ndarray) -> np.ndarray:
        if counter.projected is None:
            return counter.costs(points)
        return counter.projected_costs(points[:, counter.projected.kept])

    @staticmethod
    def _order(counter: Counter, spread: Spread, points: np.ndarray, costs: np.ndarray) -> Iterator[int]:
        """Numbers of the sample's points, as starts; only coordinates that are searched keep them apart."""
        places = spread.places(points)
        return far_apart(places if counter.projected is None else places[:, counter.projected.kept], costs)

    def _search(self, objective: Objective, counter: Counter, start: np.ndarray, budget: int, steps: int) -> Found:
        if by_residuals(objective, budget):
            return trust_region(counter, start, Loss(), steps)
        return lbfgsb(counter, start, steps)

    def _starts(
        self,
        objective: Objective,
        budget: int,
        counter: Counter,
        basins: Basins,
        spread: Spread,
        points: np.ndarray,
        costs: np.ndarray,
        rng: np.random.Generator,
        together: bool,
    ) -> Iterator[Start]:
        """Best sample, warm starts, further samples far from each other, then in turn the next sample, a step away
        from the best point, a new point of the spread. A second, larger sample is drawn when twice `searches` starts
        met several optima."""
        order = self._order(counter, spread, points, costs)
        warm = [] if objective.start is None else list(np.clip(np.asarray(objective.start, dtype=float), 0.0, 1.0))
        first = [Start(points[i]) for i in islice(order, self.searches)]
        yield from [*first[:1], *(Start(x, asked=True) for x in warm), *first[1:]]
        later, given, fresh = order, self.searches, self.second > 0.0
        while True:
            if fresh and given >= 2 * self.searches and basins.several and together:
                fresh = False
                # half of what is left is for the searches that begin there
                allowed = min(self.second * budget, 0.5 * counter.remaining)
                points, costs = self._sample(objective, allowed, counter, spread, rng, large=True)
                later = self._order(counter, spread, points, costs)
            following = next(later, None)
            if following is not None:
                given += 1
                yield Start(points[following])
            if np.isfinite(counter.best_cost):
                width = 10 ** rng.uniform(-2, -0.5)
                given += 1
                yield Start(
                    np.clip(counter.best_x + width * rng.standard_normal(objective.dimension), 0.0, 1.0),
                    independent=False,
                )
            given += 1
            yield Start(spread.points(rng.random((CHUNK, objective.dimension)), rng)[rng.integers(CHUNK)])
