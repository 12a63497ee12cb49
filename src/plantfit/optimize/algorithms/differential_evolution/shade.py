"""SHADE: differential evolution with a success history and a fixed population."""

from dataclasses import dataclass

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.population import Members
from plantfit.optimize.algorithms.differential_evolution.success_history import Memory, SuccessHistory, lehmer
from plantfit.optimize.contract import Facts
from plantfit.optimize.settings import integer

import jax.numpy as jnp
from jax import Array


@dataclass(frozen=True)
class Shade(SuccessHistory):
    """Success-history based adaptive differential evolution (Tanabe and Fukunaga 2013, IEEE CEC, pp. 71-78).

    Every member draws its own p from U(2/N, 0.2) (eq. 8); the memory takes the weighted arithmetic mean of the
    successful CR (eq. 5-6) and the weighted Lehmer mean of F (eq. 7). It needs no schedule.
    """

    history: int = integer(100, 1, 1000, "slots of the memory of successful F and CR")

    def default_population(self, facts: Facts) -> int:
        return min(100, 10 * facts.dimension)  # the paper's 100 was set in 30 dimensions

    def greediness(self, u: Array, members: Members) -> Array:
        low = 2 / members.live
        return low + u * jnp.maximum(0.2 - low, 0.0)

    def written(self, memory: Memory, weights: Array, factor: Array, rate: Array) -> Memory:
        k = memory.slot
        return Memory(
            memory.factor.at[k].set(lehmer(weights, factor)),
            memory.rate.at[k].set(jnp.sum(weights * rate)),
            (k + 1) % self.history,
        )
