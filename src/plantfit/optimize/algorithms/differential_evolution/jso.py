"""jSO: L-SHADE with a schedule for its control parameters."""

import math
from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.lshade import LShade
from plantfit.optimize.algorithms.differential_evolution.population import Members, elapsed, pick
from plantfit.optimize.algorithms.differential_evolution.success_history import Memory, lehmer
from plantfit.optimize.contract import Facts
from plantfit.optimize.settings import integer, number

import jax.numpy as jnp
from jax import Array

FIXED = 0.9  # what the last slot of the memory reads as, for F and CR


@dataclass(frozen=True)
class Jso(LShade):
    """Single objective real-parameter optimization: algorithm jSO (Brest, Maucec and Boskovic 2017, IEEE CEC, pp.
    1311-1318).

    The mutation is current-to-pbest-w/1: F_w = 0.7 F, 0.8 F, then 1.2 F. CR is at least 0.7 and then 0.6 in the first
    half, F at most 0.7 while t < 0.6, p falls linearly from `greed` to `last_greed`. The memory begins at
    (0.3, 0.8), takes the mean of its old value and the Lehmer mean of the successes, and its last slot reads as
    (0.9, 0.9). pbest differs from its target in the first half, as in the authors' program.
    N0 = 25 ln(d) sqrt(d), capped by the budget as in L-SHADE.
    """

    first_factor: ClassVar[float] = 0.3
    first_rate: ClassVar[float] = 0.8
    history: int = integer(5, 2, 1000, "slots of the memory of successful F and CR, the last of them fixed")
    archive: float = number(1.0, 0.0, 10.0, "size of the archive of beaten parents, in populations")
    greed: float = number(0.25, 0.0, 1.0, "share of the population that counts as best in the mutation, at the start")
    last_greed: float = number(0.125, 0.0, 1.0, "the same share at the end of the budget")

    def default_population(self, facts: Facts) -> int:
        # the formula gives 0 in one dimension
        d = facts.dimension
        return self.capped(max(round(25 * math.log(d) * math.sqrt(d)), 18), facts.budget)

    def greediness(self, u: Array, members: Members) -> Array:
        return self.greed + (self.last_greed - self.greed) * elapsed(members)

    def pbest(self, u: Array, top: Array, base: Array, t: Array) -> Array:
        barred = (t < 0.5) & (base < top)
        index = pick(u, top - barred)
        return index + (barred & (index >= base))

    def limits(self, factor: Array, rate: Array, t: Array) -> tuple[Array, Array]:
        rate = jnp.maximum(rate, jnp.where(t < 0.25, 0.7, jnp.where(t < 0.5, 0.6, 0.0)))
        return jnp.where(t < 0.6, jnp.minimum(factor, 0.7), factor), rate

    def pull(self, factor: Array, t: Array) -> Array:
        return factor * jnp.where(t < 0.2, 0.7, jnp.where(t < 0.4, 0.8, 1.2))

    def recalled(self, memory: Memory) -> tuple[Array, Array]:
        return memory.factor.at[-1].set(FIXED), memory.rate.at[-1].set(FIXED)

    def slots(self) -> int:
        """Slots that are written in turn."""
        return self.history

    def written(self, memory: Memory, weights: Array, factor: Array, rate: Array) -> Memory:
        k = memory.slot
        return Memory(
            memory.factor.at[k].set((memory.factor[k] + lehmer(weights, factor)) / 2),
            memory.rate.at[k].set((memory.rate[k] + lehmer(weights, rate)) / 2),
            (k + 1) % self.slots(),
        )
