"""L-SHADE: the success history with a population that shrinks linearly."""

from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.population import SMALLEST, Members, elapsed
from plantfit.optimize.algorithms.differential_evolution.success_history import TERMINAL, Memory, SuccessHistory, lehmer
from plantfit.optimize.contract import Facts, Needs
from plantfit.optimize.settings import choice, number

import jax.numpy as jnp
from jax import Array

LEAST_GENERATIONS = 100  # of the first population that the budget must cover


@dataclass(frozen=True)
class LShade(SuccessHistory):
    """SHADE with linear population size reduction (Tanabe and Fukunaga 2014, IEEE CEC, pp. 1658-1665).

    N = N0 - (N0 - 4) t with t the share of the budget that is spent (eq. 10), the archive in proportion. The paper
    rounds N to the nearest number, `rounding` "nearest". Here N is rounded down: the smallest populations gain the most
    digits for an evaluation, and then they have twice as many (docs/bbob.md). A memory slot whose successes all had CR
    = 0 stays at CR = 0 (algorithm 1). N0 = 18 d, but no more than lets the budget cover 100 generations of N0 (at least
    50): in 310 dimensions 18 d would be 5580.
    """

    needs: ClassVar[Needs] = Needs(schedule_bound=True, minimum_population=SMALLEST)
    archive: float = number(2.6, 0.0, 10.0, "size of the archive of beaten parents, in populations")
    rounding: str = choice(
        "down", ("down", "nearest"), "how the size of the shrinking population is rounded; nearest is the paper's"
    )
    greed: float = number(0.11, 0.0, 1.0, "share of the population that counts as best in the mutation")

    def default_population(self, facts: Facts) -> int:
        return self.capped(18 * facts.dimension, facts.budget)

    def capped(self, wanted: int, budget: int) -> int:
        """`wanted` members or as many as the budget can feed."""
        return min(wanted, max(50, budget // LEAST_GENERATIONS))

    def size(self, members: Members) -> Array:
        wanted = members.first - (members.first - SMALLEST) * elapsed(members)
        wanted = (jnp.floor(wanted) if self.rounding == "down" else jnp.round(wanted)).astype(int)
        return jnp.clip(wanted, SMALLEST, members.live)

    def renewed(self, rest: Array, rows: int) -> Array:
        return jnp.clip(rest // LEAST_GENERATIONS, min(rows, 10), rows)

    def greediness(self, u: Array, members: Members) -> Array:
        return jnp.asarray(self.greed)

    def written(self, memory: Memory, weights: Array, factor: Array, rate: Array) -> Memory:
        k = memory.slot
        none = (jnp.sum(weights * rate) == 0) | (memory.rate[k] == TERMINAL)
        return Memory(
            memory.factor.at[k].set(lehmer(weights, factor)),
            memory.rate.at[k].set(jnp.where(none, TERMINAL, lehmer(weights, rate))),
            (k + 1) % self.history,
        )
