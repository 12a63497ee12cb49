"""BIPOP-CMA-ES: restarts that alternate between growing populations and small ones with small steps."""

import math
from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status
from plantfit.optimize.algorithms.cma_es.restarts import Restarts, first_population
from plantfit.optimize.contract import Needs, Objective
from plantfit.optimize.local.starts import generator
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.settings import integer, number

import jax
from jax import Array


@dataclass(frozen=True)
class BipopCmaEs:
    """CMA-ES with two restart regimes (Hansen 2009, Benchmarking a BI-Population CMA-ES on the BBOB-2009 Function
    Testbed, GECCO companion, 2389).

    After a first run, the regime that has spent less goes next. The large one doubles its population each time. The
    small one draws a population between the first one and half the last large one, and a first step size down to a
    hundredth, and may spend half of what the last large run spent. Converged when the large one has used up its
    restarts.

    Small populations are rounded to first * 2^(k / 2), because every new one compiles anew.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=4)
    population: int | None = integer(
        None, 4, 100_000, "candidates per generation of the first run; by default 4 + 3 ln(d)"
    )
    sigma: float | None = number(None, 1e-6, 1.0, "first step size, as a share of each range; by default as in cmaes")
    restarts: int = integer(9, 0, 20, "how many times the population of the large regime is doubled")

    def run(self, key: Array, objective: Objective, budget: int, counter: Counter) -> Status:
        runs = Restarts(key, objective, counter, self.sigma)
        rng = generator(jax.random.fold_in(key, 2**30))
        first = self.population or first_population(objective.dimension)
        runs.run(first)
        large = small = last_large = doublings = 0
        while True:
            if large <= small:
                if doublings == self.restarts:
                    return Status.converged
                doublings += 1
                last_large = runs.run(first * 2**doublings)
                large += last_large
            else:
                rows, shrink = small_run(first, first * 2**doublings, *rng.random(2))
                small += runs.run(rows, shrink, max(last_large / 2, rows))


def small_run(first: int, large: int, u: float, v: float) -> tuple[int, float]:
    """Population and share of the first step size of a small run, from two uniform numbers: Hansen 2009, section 2."""
    exact = first * (0.5 * large / first) ** (u * u)
    half_octaves = math.floor(2 * math.log2(exact / first) + 0.5)
    return math.floor(first * 2 ** (half_octaves / 2)), 10 ** (-2 * v)
