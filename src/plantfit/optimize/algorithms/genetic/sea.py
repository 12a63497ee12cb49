"""Simple evolutionary algorithm: tournament, Gaussian mutation, elite."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array, lax

FINEST = 1e-8  # smallest step of harmonic mutation, as a share of the largest


class Herd(NamedTuple):
    """Individuals (n, d), their costs (n,); counters since the start."""

    x: Array
    f: Array
    generation: Array
    since_improvement: Array


@dataclass(frozen=True)
class SimpleEvolution:
    """Every child is the winner of a tournament with Gaussian noise on every coordinate, mirrored at the bounds;
    the best of the old generation take the places of the worst children.

    With "fixed" steps, as in the root of a hierarchic memetic strategy (Schaefer and Kolodziej 2003, FOGA 7:401), the
    population goes on exploring and never settles. With "harmonic" ones each child draws the logarithm of its step
    evenly over eight decades, which finds any precision without a schedule (Dietzfelbinger, Rowe, Wegener and
    Woelfel 2011, Algorithmica 59:301). Stagnated after 100 + 20 d generations without a better point.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=3)
    population: int | None = integer(
        None, 3, 100_000, "individuals; by default 10 + 2 d, at most a twentieth of the budget"
    )
    mutation: float = number(
        0.25, 1e-6, 1.0, "standard deviation of the noise, the largest of harmonic steps, as a share of each range"
    )
    steps: str = choice(
        "harmonic", ("harmonic", "fixed"), "whether each child draws its own step, or all take the largest"
    )
    tournament: int = integer(2, 1, 100, "individuals that compete to be a parent")
    elite: int = integer(1, 0, 1000, "best individuals that survive")

    def rows(self, facts: Facts) -> int:
        if self.population is not None:
            return self.population
        return max(3, min(10 + 2 * facts.dimension, max(10, facts.budget // 20)))

    def init(self, key: Array, facts: Facts) -> Herd:
        shape, zero = (self.rows(facts), facts.dimension), jnp.zeros((), int)
        return Herd(jax.random.uniform(key, shape), jnp.full(shape[0], jnp.inf), zero, zero)

    def ask(self, key: Array, state: Herd) -> tuple[Array, Herd]:
        return jnp.where(state.generation == 0, state.x, self._children(key, state)), state

    def _children(self, key: Array, state: Herd) -> Array:
        n, d = state.x.shape
        meet, scale, noise = jax.random.split(key, 3)
        rivals = jnp.floor(n * jax.random.uniform(meet, (n, self.tournament))).astype(int)
        winners = jnp.take_along_axis(rivals, jnp.argmin(state.f[rivals], axis=1)[:, None], axis=1)[:, 0]
        step = jnp.full((n, 1), self.mutation)
        if self.steps == "harmonic":
            step = step * FINEST ** jax.random.uniform(scale, (n, 1))
        return mirrored(state.x[winners] + step * jax.random.normal(noise, (n, d)))

    def tell(self, state: Herd, x: Array, f: Array) -> tuple[Herd, Info]:
        kept = min(self.elite, len(f) - 1)
        best, worst = lax.top_k(-state.f, kept)[1], lax.top_k(f, kept)[1]
        begun = state.generation > 0
        survivors = jnp.where(begun, x.at[worst].set(state.x[best]), x)
        costs = jnp.where(begun, f.at[worst].set(state.f[best]), f)
        since = jnp.where(jnp.min(f) < jnp.min(state.f), 0, state.since_improvement + 1)
        return Herd(survivors, costs, state.generation + 1, since), {"stagnated": since > 100 + 20 * x.shape[1]}


def mirrored(x: Array) -> Array:
    """Points folded back at the faces of the cube, however far outside they are."""
    y = x % 2.0
    return jnp.where(y > 1.0, 2.0 - y, y)
