"""IPOP-CMA-ES: every restart doubles the population."""

from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status
from plantfit.optimize.algorithms.cma_es.restarts import Restarts, first_population
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer, number

from jax import Array


@dataclass(frozen=True)
class IpopCmaEs:
    """Restart CMA-ES with increasing population (Auger and Hansen 2005, IEEE CEC, 1769).

    Larger populations see the coarse shape of a cost with many local minima. Converged when all restarts are used up.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=4)
    population: int | None = integer(
        None, 4, 100_000, "candidates per generation of the first run; by default 4 + 3 ln(d)"
    )
    sigma: float | None = number(None, 1e-6, 1.0, "first step size, as a share of each range; by default as in cmaes")
    restarts: int = integer(9, 0, 20, "how many times the population is doubled")

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        runs = Restarts(key, objective, counter, self.sigma)
        rows = self.population or first_population(objective.dimension)
        for doublings in range(self.restarts + 1):
            runs.run(rows * 2**doublings)
        return Status.converged
