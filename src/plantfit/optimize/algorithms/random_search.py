"""Uniform random search: the baseline that every method must beat."""

from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import integer

import jax
from jax import Array


@dataclass(frozen=True)
class RandomSearch:
    """Independent uniform points (Bergstra and Bengio 2012, JMLR 13:281)."""

    needs: ClassVar[Needs] = Needs(baseline=True)
    population: int = integer(64, 1, 100_000, "points evaluated side by side; they do not depend on each other")

    def rows(self, facts: Facts) -> int:
        return min(self.population, facts.budget)

    def init(self, key: Array, facts: Facts) -> Array:
        return jax.numpy.zeros((self.rows(facts), facts.dimension))

    def ask(self, key: Array, state: Array) -> tuple[Array, Array]:
        return jax.random.uniform(key, state.shape), state

    def tell(self, state: Array, x: Array, f: Array) -> tuple[Array, Info]:
        return state, {}
