"""Differential evolution whose F and CR follow a memory of what succeeded; the base of shade, lshade, jso and dish."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.differential_evolution.population import (
    SMALLEST,
    Archive,
    Members,
    between,
    binomial,
    collapsed,
    elapsed,
    newcomers,
    parents,
    pick,
    pick_other,
    positive_cauchy,
    remember,
    restart,
    select,
    shrink,
    uniform_if,
)
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import integer, number

import jax
import jax.numpy as jnp
from jax import Array

TERMINAL = -1.0  # a crossover memory that stays at rate 0 (the mark of L-SHADE, written ⊥ there)
MOST_RESTARTS = 1_000_000


class Memory(NamedTuple):
    """Successful factors F and rates CR, (history,) each, and the slot written next."""

    factor: Array
    rate: Array
    slot: Array


class Search(NamedTuple):
    """State: the population, its archive and memory, and the controls behind the candidates under way."""

    members: Members
    archive: Archive
    memory: Memory
    factor: Array  # (rows,)
    rate: Array  # (rows,)
    priority: Array  # random order of archive and newly beaten parents


def lehmer(weights: Array, values: Array) -> Array:
    """Weighted Lehmer mean, sum w s^2 / sum w s; 0 when every s is 0."""
    total = jnp.sum(weights * values)
    return jnp.where(total > 0, jnp.sum(weights * values**2) / jnp.where(total > 0, total, 1.0), 0.0)


@dataclass(frozen=True)
class SuccessHistory(ABC):
    """The common step: current-to-pbest/1/bin with an archive and a success history.

    v = x_i + F_w (x_pbest - x_i) + F (x_r1 - x_r2), x_r2 from population and archive (Zhang and Sanderson 2009,
    IEEE TEC 13:945, eq. 6); F ~ Cauchy(M_F, 0.1), CR ~ N(M_CR, 0.1) with M_F and M_CR of a random slot (Tanabe
    and Fukunaga 2013, IEEE CEC, eq. 1-2). A mutant outside the cube goes halfway back to its base. A member that
    could not be simulated is no parent: its row searches from one that could.
    A collapsed population begins anew with what is left of the budget.
    """

    needs: ClassVar[Needs] = Needs(minimum_population=SMALLEST)
    first_factor: ClassVar[float] = 0.5
    first_rate: ClassVar[float] = 0.5
    population: int | None = integer(
        None, SMALLEST, 100_000, "members at the start; the default grows with the dimension"
    )
    history: int = integer(6, 2, 1000, "slots of the memory of successful F and CR")
    archive: float = number(1.0, 0.0, 10.0, "size of the archive of beaten parents, in populations")
    restarts: int = integer(
        9, 0, MOST_RESTARTS, "how many times the search may begin anew after its population collapsed"
    )

    @abstractmethod
    def default_population(self, facts: Facts) -> int:
        """Members at the start when the user gives none."""

    def size(self, members: Members) -> Array:
        """Members of the next generation."""
        return members.live

    def renewed(self, rest: Array, rows: int) -> Array:
        """Members of a population that begins anew with `rest` evaluations left."""
        return jnp.asarray(rows)

    @abstractmethod
    def greediness(self, u: Array, members: Members) -> Array:
        """Share p of the population that pbest is drawn from, a number or (rows,); u is in [0, 1)."""

    def pbest(self, u: Array, top: Array, base: Array, t: Array) -> Array:
        """Rows of pbest among the best `top`."""
        return pick(u, top)

    def limits(self, factor: Array, rate: Array, t: Array) -> tuple[Array, Array]:
        """F and CR within what the schedule allows at time t."""
        return factor, rate

    def pull(self, factor: Array, t: Array) -> Array:
        """F_w, the factor towards pbest."""
        return factor

    def recalled(self, memory: Memory) -> tuple[Array, Array]:
        """M_F and M_CR as they are read, (history,) each."""
        return memory.factor, memory.rate

    def weights(self, gain: Array, distance: Array) -> Array:
        """Weights of the successes, not yet normalised, from their gain in cost and their distance ||u - x||."""
        return gain

    @abstractmethod
    def written(self, memory: Memory, weights: Array, factor: Array, rate: Array) -> Memory:
        """The memory after a generation with at least one success; `weights` sum to 1 and are 0 for failures."""

    def rows(self, facts: Facts) -> int:
        if self.population is not None:
            return self.population
        return max(self.default_population(facts), SMALLEST)

    def live(self, state: Search) -> Array:
        return state.members.live

    def init(self, key: Array, facts: Facts) -> Search:
        rows, d = self.rows(facts), facts.dimension
        capacity = round(self.archive * rows)
        archive = Archive(jnp.zeros((capacity, d)), jnp.zeros((), int))
        half = jnp.full(rows, 0.5)
        return Search(newcomers(rows, d, facts.budget), archive, self._blank(), half, half, jnp.zeros(capacity + rows))

    def _blank(self) -> Memory:
        return Memory(
            jnp.full(self.history, self.first_factor), jnp.full(self.history, self.first_rate), jnp.zeros((), int)
        )

    def ask(self, key: Array, state: Search) -> tuple[Array, Search]:
        control, mix, order, place = jax.random.split(key, 4)
        factor, rate = self._controls(control, state)
        trial = self._trials(mix, state, factor, rate)
        x = uniform_if(state.members.fresh, place, trial)
        return x, state._replace(factor=factor, rate=rate, priority=jax.random.uniform(order, state.priority.shape))

    def _controls(self, key: Array, state: Search) -> tuple[Array, Array]:
        numbers, normal = jax.random.split(key)
        u = jax.random.uniform(numbers, (2, len(state.factor)))
        slot = pick(u[0], jnp.asarray(self.history))
        mean_factor, mean_rate = (m[slot] for m in self.recalled(state.memory))
        rate = jnp.clip(mean_rate + 0.1 * jax.random.normal(normal, mean_rate.shape), 0.0, 1.0)
        rate = jnp.where(mean_rate == TERMINAL, 0.0, rate)
        return self.limits(positive_cauchy(u[1], mean_factor), rate, elapsed(state.members))

    def _trials(self, key: Array, state: Search, factor: Array, rate: Array) -> Array:
        members, t = state.members, elapsed(state.members)
        (rows, d), count = members.x.shape, parents(members)
        numbers, crossing = jax.random.split(key)
        u = jax.random.uniform(numbers, (5, rows))
        base = jnp.arange(rows) % count
        share = self.greediness(u[0], members)
        top = jnp.clip(jnp.round(share * members.live).astype(int), 2, count)
        first = pick_other(u[2], count, base)
        second = pick_other(u[3], count + state.archive.count, base, first)
        pool = jnp.concatenate([members.x, state.archive.x])
        second = jnp.where(second < count, second, rows + second - count)
        x, far = members.x[base], members.x[self.pbest(u[1], top, base, t)]
        v = x + self.pull(factor, t)[:, None] * (far - x) + factor[:, None] * (members.x[first] - pool[second])
        return binomial(jax.random.uniform(crossing, (rows, d)), pick(u[4], jnp.asarray(d)), rate, between(v, x), x)

    def tell(self, state: Search, x: Array, f: Array) -> tuple[Search, Info]:
        old = state.members
        better = (f < old.f) & jnp.isfinite(old.f) & ~old.fresh
        told = select(old, x, f)
        told = shrink(told, self.size(told))
        limit = jnp.round(self.archive * told.live).astype(int)
        archive = remember(state.archive, better, old.x, state.priority, jnp.minimum(limit, len(state.archive.x)))
        new = state._replace(members=told, archive=archive, memory=self._learn(state, better, x, f))
        over = collapsed(told)
        anew = restart(told, self.renewed(told.budget - told.evaluations, len(f)))
        fresh = new._replace(
            members=anew, memory=self._blank(), archive=Archive(archive.x, jnp.zeros_like(archive.count))
        )
        stop = over & (told.restarts >= self.restarts)
        return jax.tree.map(lambda a, b: jnp.where(over, a, b), fresh, new), {"stop": stop}

    def _learn(self, state: Search, better: Array, x: Array, f: Array) -> Memory:
        old = state.members
        gain = jnp.where(better, jnp.minimum(old.f - f, 1e300), 0.0)
        distance = jnp.where(better, jnp.linalg.norm(x - old.x, axis=1), 0.0)
        raw = self.weights(gain, distance)
        raw = raw / jnp.maximum(jnp.max(raw), 1e-300)  # before the sum, which could overflow
        raw = jnp.where(jnp.sum(raw) > 0, raw, better.astype(float))
        weights = raw / jnp.maximum(jnp.sum(raw), 1e-300)
        memory = self.written(state.memory, weights, state.factor, state.rate)
        return jax.tree.map(lambda a, b: jnp.where(jnp.any(better), a, b), memory, state.memory)
