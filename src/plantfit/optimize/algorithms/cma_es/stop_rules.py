"""When an evolution strategy has nothing left to find: Hansen 2016, arXiv:1604.00772, section B.3."""

import math
from typing import NamedTuple

import plantfit.runtime  # noqa: F401

import jax.numpy as jnp
from jax import Array

NARROW = 1e-11  # of a range
LEVEL = 1e-12  # of the best cost
WIDE = 1e4  # times the first step
CROOKED = 1e7  # ratio of axes: condition 1e14


class Memory(NamedTuple):
    """Since the last restart: generations, generations without improvement, best cost, ring of the last best costs."""

    generation: Array
    since_improvement: Array
    best: Array
    bests: Array


def nothing_yet(rows: int, dimension: int) -> Memory:
    """The ring holds 10 + 30 d / rows generations."""
    zero = jnp.zeros((), int)
    return Memory(zero, zero, jnp.asarray(jnp.inf), jnp.full(10 + math.ceil(30 * dimension / rows), jnp.inf))


def remember(memory: Memory, f: Array) -> Memory:
    lowest = jnp.min(f)
    return Memory(
        memory.generation + 1,
        jnp.where(lowest < memory.best, 0, memory.since_improvement + 1),
        jnp.minimum(memory.best, lowest),
        jnp.roll(memory.bests, 1).at[0].set(lowest),
    )


def exhausted(memory: Memory, f: Array, dimension: int) -> Array:
    """TolFun, relative to the best cost and with the costs of this generation, and stagnation."""
    full = memory.generation >= len(memory.bests)
    tolerance = LEVEL * jnp.abs(memory.best)
    level = full & (jnp.max(memory.bests) - jnp.min(memory.bests) <= tolerance)
    level = level & (jnp.max(jnp.where(jnp.isfinite(f), f, -jnp.inf)) - jnp.min(f) <= tolerance)
    return level | (memory.since_improvement > 100 + 100 * dimension**1.5 / len(f))


def degenerate(
    mean: Array, sigma: Array, first: Array, variances: Array, path: Array, lengths: Array, axis: Array
) -> Array:
    """TolX, TolXUp, condition, NoEffectAxis and NoEffectCoord, or numbers that are not finite.

    `lengths` (d,) are the axes of the distribution up to sigma, `axis` (d,) the one to look along.
    """
    deviations = jnp.sqrt(jnp.maximum(variances, 0.0))
    narrow = sigma * jnp.max(jnp.maximum(deviations, jnp.abs(path))) < NARROW
    wide = sigma * jnp.max(lengths) > WIDE * first
    crooked = jnp.max(lengths) > CROOKED * jnp.min(lengths)
    no_effect = jnp.all(mean + 0.1 * sigma * axis == mean) | jnp.any(mean + 0.2 * sigma * deviations == mean)
    broken = ~(jnp.all(jnp.isfinite(variances)) & jnp.isfinite(sigma) & jnp.all(jnp.isfinite(mean)))
    return narrow | wide | crooked | no_effect | broken
