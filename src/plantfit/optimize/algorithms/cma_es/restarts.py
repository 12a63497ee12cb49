"""One CMA-ES run after another, from inside a host method."""

import math
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.cmaes import CmaEs
from plantfit.optimize.contract import Facts, Objective
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.nested import Nested

import jax
import jax.numpy as jnp
from jax import Array


def first_population(dimension: int) -> int:
    """4 + 3 ln(d) candidates (Hansen 2016, eq. 48)."""
    return 4 + math.floor(3 * math.log(dimension))


@dataclass
class Restarts:
    """Runs of CMA-ES on one objective, numbered in order; each has a key of its own.

    The first begins at the warm starts, the others at uniform points. The second, fourth, ... fold candidates back at
    the bounds, as restarts of CmaEs do.
    """

    key: Array
    objective: Objective
    counter: Counter
    sigma: float | None
    runs: int = 0

    def run(self, population: int, shrink: float = 1.0, most: float = math.inf) -> int:
        """One run with a first step size `shrink` times the usual one, of at most `most` evaluations; what it spent.

        Raises what the counter raises.
        """
        start = np.clip(self.objective.start, 0.0, 1.0) if self.runs == 0 and self._warm else None  # pyrefly: ignore[no-matching-overload]
        facts = Facts(
            self.objective.dimension, int(self.counter.budget), self.objective.lower, self.objective.upper, start
        )
        method = CmaEs(population=population, sigma=self.sigma if start is not None else self._cold(), restarts=0)
        nested = Nested(method, facts, jax.random.fold_in(self.key, self.runs))
        if shrink != 1.0:
            # in the state, not in the settings: every new setting would compile anew
            sigma = jnp.asarray(method.sigma * shrink, float)  # pyrefly: ignore[unsupported-operation]
            nested.state = nested.state._replace(sigma=sigma, first=sigma)
        # the parity of its number tells how a search keeps the bounds
        nested.state = nested.state._replace(restarts=jnp.asarray(self.runs, nested.state.restarts.dtype))
        self.runs += 1
        while not nested.stopped and nested.evaluations + population <= most:
            nested.generation(self.counter)
        self.counter.extra["restarts"] = self.runs - 1
        return nested.evaluations

    @property
    def _warm(self) -> bool:
        return self.objective.start is not None and len(self.objective.start) > 0

    def _cold(self) -> float:
        # after a trusted guess the next search looks anywhere
        return max(self.sigma or 0.3, 0.3) if self._warm else self.sigma or 0.3
