"""Genetic algorithm with a breeding elite and waves of immigrants."""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.genetic import operators
from plantfit.optimize.algorithms.genetic.operators import Pool
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array


class Generation(NamedTuple):
    """The sorted population, the generation and how many the budget allows."""

    pool: Pool
    generation: Array
    horizon: Array


@dataclass(frozen=True)
class EliteGenetic:
    """Elite-pool genetic algorithm with immigration.

    One parent comes from the best e, the other from the rest, one-point crossover cuts between genes, one random gene
    moves by U[-gamma, gamma], and m members are drawn anew ("The Use of a Statistical Filter and Metaheuristics to
    Model and Control the DC Motor of the Mobile Robot Used on NXP Cup", 2018, eq. 14, 15 and 19). The best e survive
    without a new evaluation: a generation evaluates N - e points, also the first, in which the places of the elite are
    empty.

    `variant` "paper" takes that paper's numbers (500 members, elite 10, 10 immigrants, a gene moves with probability
    0.2) and keeps both children of a pair; "general" has 50 members, an elite of 20 %, 10 % immigrants, moves a gene of
    every child and keeps one child of a pair at random. The paper draws first genes from [-lambda, lambda] and gives
    gamma in units of the gene; here both follow the bounds, gamma as a share of each range. A constant gamma sets the
    precision that can be reached (5-D sphere, cost over 20 000 evaluations: 8e-7 at 0.01, 2e-5 at 0.05, 4e-4 at 0.3);
    `schedule` "linear" lets it fall to 0 at the end of the budget. With one coordinate crossover only copies.
    """

    needs: ClassVar[Needs] = Needs()
    variant: str = choice(
        "general", ("general", "paper"), "general: these defaults; paper: numbers and pairs of the 2018 paper"
    )
    population: int | None = integer(None, 4, 100_000, "members; by default 50, in the paper 500")
    elite: int | None = integer(None, 1, 100_000, "members that breed and survive; by default 20 %, in the paper 10")
    immigrants: int | None = integer(
        None, 0, 100_000, "uniform points per generation; by default 10 %, in the paper 10"
    )
    mutation_rate: float | None = number(
        None, 0.0, 1.0, "probability that one gene of a child moves; by default 1, in the paper 0.2"
    )
    gamma: float = number(0.05, 1e-12, 1.0, "largest move of a gene, as a share of its range")
    schedule: str = choice("constant", ("constant", "linear"), "gamma over the budget: constant, or falling to 0")

    def __post_init__(self) -> None:
        if self.schedule == "linear":
            object.__setattr__(self, "needs", Needs(schedule_bound=True))

    def sizes(self) -> tuple[int, int, int]:
        """Members, elite and immigrants; at least one place is left for children."""
        paper = self.variant == "paper"
        n = self.population or (500 if paper else 50)
        e = self.elite or (10 if paper else math.ceil(0.2 * n))
        m = self.immigrants if self.immigrants is not None else (10 if paper else math.ceil(0.1 * n))
        e = min(e, n - 1)
        return n, e, min(m, n - e - 1)

    def rows(self, facts: Facts) -> int:
        n, e, _ = self.sizes()
        return n - e

    def init(self, key: Array, facts: Facts) -> Generation:
        n, e, _ = self.sizes()
        pool = operators.empty_pool(jax.random.uniform(key, (n, facts.dimension)))
        return Generation(pool, jnp.zeros((), int), jnp.asarray(facts.budget // (n - e)))

    def ask(self, key: Array, state: Generation) -> tuple[Array, Generation]:
        n, e, m = self.sizes()
        d, count = state.pool.x.shape[1], n - e - m
        cross, mutate, immigrants = operators.uniforms(key, (4, count, 1), (3, count, 1), (m, d))
        children = self._mutate(mutate, self._cross(cross, state.pool), state)
        return jnp.where(state.generation == 0, state.pool.x[e:], jnp.concatenate([children, immigrants])), state

    def _cross(self, u: Array, pool: Pool) -> Array:
        count, d = u.shape[1], pool.x.shape[1]
        both = self.variant == "paper"
        a, b = self._parents(u[:2, : -(-count // 2) if both else count, 0], pool)
        head = jnp.arange(d) < operators.pick(u[2, : len(a)], 1, d)
        if both:
            return jnp.concatenate([jnp.where(head, a, b), jnp.where(head, b, a)])[:count]
        return jnp.where(head ^ (u[3] < 0.5), a, b)

    def _parents(self, u: Array, pool: Pool) -> tuple[Array, Array]:
        """One of the elite and one of the rest for every child; of the elite too when nobody else is left."""
        _, e, _ = self.sizes()
        alive = pool.alive()
        mates = operators.pick(u[1], jnp.where(alive > e, e, 0), alive)
        return pool.x[operators.pick(u[0], 0, jnp.minimum(e, alive))], pool.x[mates]

    def _mutate(self, u: Array, z: Array, state: Generation) -> Array:
        rate = self.mutation_rate if self.mutation_rate is not None else (0.2 if self.variant == "paper" else 1.0)
        left = 1 - state.generation / state.horizon if self.schedule == "linear" else 1.0
        step = self.gamma * left * (2 * u[0] - 1)
        gene = jnp.arange(z.shape[1]) == operators.pick(u[1], 0, z.shape[1])
        moved = gene & (u[2] < rate)
        return jnp.clip(jnp.where(moved, z + step, z), 0.0, 1.0)

    def tell(self, state: Generation, x: Array, f: Array) -> tuple[Generation, Info]:
        _, e, _ = self.sizes()
        pool = operators.replace_generation(state.pool, e, x, f)
        return Generation(pool, state.generation + 1, state.horizon), {}
