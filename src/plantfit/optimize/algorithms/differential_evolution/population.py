"""What the methods of differential evolution share: the population and its draws, mutation, crossover and selection.

A population keeps its members sorted by cost, so that the pbest of a mutation, the members that failed and
those that a shrinking population drops are all told by their row alone.
"""

import math
from typing import NamedTuple

import plantfit.runtime  # noqa: F401

import jax
import jax.numpy as jnp
from jax import Array

SMALLEST = 4  # members that current-to-pbest/1 needs


class Members(NamedTuple):
    """The population: rows beyond `live` are not in it."""

    x: Array  # (rows, d), best first
    f: Array  # (rows,)
    live: Array
    first: Array  # `live` when this population was new
    fresh: Array  # the next generation is a new uniform population
    evaluations: Array  # of the whole run
    begun: Array  # evaluations when this population was new
    budget: Array
    restarts: Array


def newcomers(rows: int, dimension: int, budget: int) -> Members:
    """A population whose first generation is still to be drawn."""
    zero, size = jnp.zeros((), int), jnp.full((), rows)
    x, f = jnp.zeros((rows, dimension)), jnp.full(rows, jnp.inf)
    return Members(x, f, size, size, jnp.asarray(True), zero, zero, jnp.full((), budget), zero)


def elapsed(members: Members) -> Array:
    """Share of the schedule that is over, t in [0, 1]: evaluations of this population over those it was given."""
    given = members.budget - members.begun
    return jnp.clip((members.evaluations - members.begun) / jnp.maximum(given, 1), 0.0, 1.0)


def parents(members: Members) -> Array:
    """How many members may be parents: those with a cost, which come first; all when fewer than four have one."""
    working = jnp.sum(jnp.isfinite(members.f))
    return jnp.where(working >= SMALLEST, working, members.live)


def pick(u: Array, count: Array) -> Array:
    """Indices 0..count-1 from numbers u in [0, 1)."""
    return jnp.minimum((u * count).astype(int), count - 1)


def pick_other(u: Array, count: Array, *excluded: Array) -> Array:
    """Indices 0..count-1 that differ from `excluded`, themselves distinct and below `count`, without rejection:
    drawn from a range shorter by their number and moved past each in ascending order."""
    index = pick(u, count - len(excluded))
    for barrier in jnp.sort(jnp.stack(jnp.broadcast_arrays(*excluded)), axis=0):
        index = index + (index >= barrier)
    return index


def positive_cauchy(u: Array, location: Array, scale: float = 0.1) -> Array:
    """Cauchy draws above 0, cut at 1, from u in [0, 1): what redrawing until positive gives, by inversion."""
    below = 0.5 - jnp.arctan(location / scale) / math.pi  # probability of a draw below 0
    draw = location + scale * jnp.tan(math.pi * (below + u * (1 - below) - 0.5))
    return jnp.clip(draw, 1e-12, 1.0)


def between(v: Array, base: Array) -> Array:
    """Mutants outside the cube, set halfway between the base and the bound they crossed."""
    return jnp.where(v < 0, base / 2, jnp.where(v > 1, (base + 1) / 2, v))


def binomial(u: Array, forced: Array, rate: Array, mutant: Array, target: Array) -> Array:
    """Trials that take each coordinate from the mutant with probability `rate`, and coordinate `forced` always."""
    crossed = (u < rate[:, None]) | (jnp.arange(target.shape[1]) == forced[:, None])
    return jnp.where(crossed, mutant, target)


def uniform_if(fresh: Array, key: Array, x: Array) -> Array:
    """A new uniform population in place of x when it is due."""
    return jax.lax.cond(fresh, lambda: jax.random.uniform(key, x.shape), lambda: x)


def select(members: Members, x: Array, f: Array) -> Members:
    """Trials replace their targets when they cost no more (all do when the population is new), then sort."""
    taken = members.fresh | (f <= members.f)
    live = jnp.arange(len(f)) < members.live
    kept_f = jnp.where(live, jnp.where(taken, f, members.f), jnp.inf)
    order = jnp.argsort(kept_f)  # stable: a live member that failed stays before the rows that are not live
    return members._replace(
        x=jnp.where(taken[:, None], x, members.x)[order], f=kept_f[order], fresh=jnp.asarray(False),
        evaluations=members.evaluations + members.live,
    )  # fmt: skip


def shrink(members: Members, size: Array) -> Members:
    """The best `size` members."""
    return members._replace(live=size, f=jnp.where(jnp.arange(len(members.f)) < size, members.f, jnp.inf))


def collapsed(members: Members) -> Array:
    """No difference left to search with: all members within 1e-12 of the cube, or all costs equal within 1e-6 of it."""
    live = (jnp.arange(len(members.f)) < members.live)[:, None]
    wide = jnp.max(jnp.where(live, members.x, -jnp.inf), axis=0) - jnp.min(jnp.where(live, members.x, jnp.inf), axis=0)
    diameter, best = jnp.max(wide), members.f[0]
    worst = members.f[members.live - 1]
    level = worst - best <= 1e-15 * jnp.abs(best)
    return jnp.isfinite(worst) & ((diameter < 1e-12) | (level & (diameter < 1e-6)))


def restart(members: Members, size: Array) -> Members:
    """The population forgotten: `size` new members are drawn next, for the rest of the budget."""
    return members._replace(
        f=jnp.full_like(members.f, jnp.inf), live=size, first=size, fresh=jnp.asarray(True), begun=members.evaluations,
        restarts=members.restarts + 1,
    )  # fmt: skip


class Archive(NamedTuple):
    """Beaten parents, in random order; rows beyond `count` are empty."""

    x: Array  # (capacity, d)
    count: Array


def remember(archive: Archive, beaten: Array, x: Array, priority: Array, limit: Array) -> Archive:
    """Add the rows of x that are `beaten`; a surplus over `limit` is removed at random by `priority` (capacity +
    rows,)."""
    capacity = len(archive.x)
    if capacity == 0:
        return archive
    filled = jnp.concatenate([jnp.arange(capacity) < archive.count, beaten])
    order = jnp.argsort(jnp.where(filled, priority, jnp.inf))[:capacity]
    return Archive(jnp.concatenate([archive.x, x])[order], jnp.minimum(jnp.sum(filled), limit))
