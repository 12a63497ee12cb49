"""Particle swarm with inertia weight, global best or ring."""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array


class Swarm(NamedTuple):
    """Positions, velocities and personal bests (n, d); their costs (n,); counters since the start."""

    x: Array
    v: Array
    best_x: Array
    best_f: Array
    generation: Array
    since_improvement: Array
    first_spread: Array


@dataclass(frozen=True)
class ParticleSwarm:
    """Synchronous particle swarm.

    v <- w v + c1 r1 (p - x) + c2 r2 (g - x), with r1 and r2 drawn anew for every coordinate (Kennedy and
    Eberhart 1995; inertia w: Shi and Eberhart 1998). The defaults are the constriction coefficients
    chi = 2 / |2 - phi - sqrt(phi^2 - 4 phi)| and chi phi / 2 at phi = 4.1 (Clerc and Kennedy 2002, eq. 4.15).
    Faults that were measured: with r1 and r2 shared by all coordinates the swarm moves in few directions and stagnates
    (10-D sphere 3e-5 instead of 1e-25); a periodic box loses an optimum on a bound (61 instead of 0). Neither is
    offered. The global swarm contracts around one leader and then has no way out of its basin (10-D Rastrigin ends near
    5). On pure noise 26 % of the final coordinates lie in the central fifth of the box and 5 % on a bound. At a bound
    "absorb" sets the coordinate onto it and turns half the velocity around, "reflect" mirrors both. Converged when the
    swarm is smaller than 1e-10 of the cube and its costs agree to 1e-12 of their first spread; stagnated after 100 + 20
    d generations without a better point.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=3)
    population: int | None = integer(None, 3, 100_000, "particles; by default 40, below 10 dimensions 10 + 2 sqrt(d)")
    inertia: float = number(0.72984, 0.0, 1.0, "share of the velocity that is kept")
    cognitive: float = number(1.49618, 0.0, 4.0, "pull towards the particle's own best point")
    social: float = number(1.49618, 0.0, 4.0, "pull towards the best point of the neighbourhood")
    max_velocity: float = number(0.5, 1e-6, 1.0, "largest step per generation, as a share of each range")
    topology: str = choice("global", ("global", "ring"), "who is a neighbour: all, or the two next to the particle")
    bounds: str = choice("absorb", ("absorb", "reflect"), "what happens at a bound")

    def rows(self, facts: Facts) -> int:
        if self.population is not None:
            return self.population
        return 40 if facts.dimension >= 10 else 10 + math.floor(2 * math.sqrt(facts.dimension))

    def init(self, key: Array, facts: Facts) -> Swarm:
        shape = (self.rows(facts), facts.dimension)
        place, aim = jax.random.split(key)
        x = jax.random.uniform(place, shape)
        v = (jax.random.uniform(aim, shape) - x) / 2
        zero = jnp.zeros((), int)
        return Swarm(x, v, x, jnp.full(shape[0], jnp.inf), zero, zero, jnp.asarray(jnp.inf))

    def ask(self, key: Array, state: Swarm) -> tuple[Array, Swarm]:
        moved_x, moved_v = self._move(key, state)
        first = state.generation == 0
        x, v = jnp.where(first, state.x, moved_x), jnp.where(first, state.v, moved_v)
        return x, state._replace(x=x, v=v)

    def _move(self, key: Array, state: Swarm) -> tuple[Array, Array]:
        r1, r2 = jax.random.uniform(key, (2, *state.x.shape))
        pull = self.cognitive * r1 * (state.best_x - state.x) + self.social * r2 * (self._leaders(state) - state.x)
        v = jnp.clip(self.inertia * state.v + pull, -self.max_velocity, self.max_velocity)
        x = state.x + v
        outside = (x < 0) | (x > 1)
        if self.bounds == "reflect":
            x, v = jnp.where(x < 0, -x, jnp.where(x > 1, 2 - x, x)), jnp.where(outside, -v, v)
        else:
            v = jnp.where(outside, -0.5 * v, v)
        return jnp.clip(x, 0.0, 1.0), v

    def _leaders(self, state: Swarm) -> Array:
        if self.topology == "global":
            return state.best_x[jnp.argmin(state.best_f)]
        n = len(state.best_f)
        around = (jnp.arange(n)[:, None] + jnp.array([-1, 0, 1])) % n
        return state.best_x[around[jnp.arange(n), jnp.argmin(state.best_f[around], axis=1)]]

    def tell(self, state: Swarm, x: Array, f: Array) -> tuple[Swarm, Info]:
        better = f < state.best_f
        best_f = jnp.where(better, f, state.best_f)
        best_x = jnp.where(better[:, None], x, state.best_x)
        improved = jnp.min(best_f) < jnp.min(state.best_f)
        since = jnp.where(improved, 0, state.since_improvement + 1)
        spread = jnp.max(best_f) - jnp.min(best_f)
        first_spread = jnp.where(jnp.isfinite(state.first_spread), state.first_spread, spread)
        diameter = jnp.max(jnp.max(x, axis=0) - jnp.min(x, axis=0))
        stop = (diameter < 1e-10) & (spread <= 1e-12 * first_spread)
        told = Swarm(x, state.v, best_x, best_f, state.generation + 1, since, first_spread)
        return told, {"stop": stop, "stagnated": since > 100 + 20 * x.shape[1]}
