"""Differential evolution with fixed F and CR."""

from dataclasses import dataclass
from typing import ClassVar

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.population import (
    SMALLEST,
    Members,
    between,
    binomial,
    collapsed,
    newcomers,
    parents,
    pick,
    pick_other,
    restart,
    select,
    uniform_if,
)
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array

MOST_RESTARTS = 1_000_000


@dataclass(frozen=True)
class DifferentialEvolution:
    """DE with binomial crossover (Storn and Price 1997, Journal of Global Optimization 11:341).

    Mutants, with r1, r2, r3 distinct and not the target: "rand/1" x_r1 + F (x_r2 - x_r3), "best/1"
    x_best + F (x_r1 - x_r2), "current-to-best/1" x_i + F (x_best - x_i) + F (x_r1 - x_r2). A coordinate outside
    the cube goes halfway back from the bound to where the mutant started (bounce-back; Price, Storn and Lampinen 2005,
    Differential Evolution, section 4.3): with the target in its place, runs in 310 dimensions cost six times as much. A
    member that could not be simulated is no parent: its row searches from one that could. A collapsed population begins
    anew.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=SMALLEST)
    population: int | None = integer(None, SMALLEST, 100_000, "members; by default 5 d, from 20 to 100")
    strategy: str = choice(
        "rand/1", ("rand/1", "best/1", "current-to-best/1"), "which mutant: how greedy the search is"
    )
    factor: float = number(0.5, 0.0, 2.0, "F, the share of a difference between members that is added")
    rate: float = number(0.9, 0.0, 1.0, "CR, probability that a coordinate comes from the mutant")
    restarts: int = integer(
        9, 0, MOST_RESTARTS, "how many times the search may begin anew after its population collapsed"
    )

    def rows(self, facts: Facts) -> int:
        return self.population if self.population is not None else min(max(5 * facts.dimension, 20), 100)

    def init(self, key: Array, facts: Facts) -> Members:
        return newcomers(self.rows(facts), facts.dimension, facts.budget)

    def ask(self, key: Array, state: Members) -> tuple[Array, Members]:
        numbers, crossing, place = jax.random.split(key, 3)
        (rows, d), count = state.x.shape, parents(state)
        u = jax.random.uniform(numbers, (4, rows))
        base = jnp.arange(rows) % count
        x = state.x[base]
        origin, difference = self._mutants(u, state.x, base, count)
        v = between(origin + self.factor * difference, origin)
        rate = jnp.full(rows, self.rate)
        trial = binomial(jax.random.uniform(crossing, (rows, d)), pick(u[3], jnp.asarray(d)), rate, v, x)
        return uniform_if(state.fresh, place, trial), state

    def _mutants(self, u: Array, x: Array, base: Array, count: Array) -> tuple[Array, Array]:
        """Where the mutants start from, and the difference that is added to it."""
        r1 = pick_other(u[0], count, base)
        r2 = pick_other(u[1], count, base, r1)
        if self.strategy == "rand/1":
            r3 = pick_other(u[2], count, base, r1, r2)
            return x[r1], x[r2] - x[r3]
        between_best = jnp.clip(x[base] + self.factor * (x[:1] - x[base]), 0.0, 1.0)  # F may be above 1
        origin = x[:1] if self.strategy == "best/1" else between_best
        return origin, x[r1] - x[r2]

    def tell(self, state: Members, x: Array, f: Array) -> tuple[Members, Info]:
        told = select(state, x, f)
        over = collapsed(told)
        anew = restart(told, told.first)
        stop = over & (told.restarts >= self.restarts)
        return jax.tree.map(lambda a, b: jnp.where(over, a, b), anew, told), {"stop": stop}
