"""Operators of genetic algorithms on the unit cube: selection, crossover, mutation, and the sorted population they work
on.

Operators take uniform numbers u in [0, 1) instead of keys: `uniforms` draws all of a generation at once, because every
call of the generator is compiled and dispatched by itself.
"""

import math
from itertools import accumulate, pairwise
from typing import NamedTuple

import plantfit.runtime  # noqa: F401

import jax
import jax.numpy as jnp
from jax import Array


class Pool(NamedTuple):
    """A population (n, ...) sorted by cost (n,), best first. Empty and failed places cost +inf and come last."""

    x: Array
    f: Array

    def alive(self) -> Array:
        """How many members may be parents: those with a finite cost, or all when there are none."""
        count = jnp.sum(jnp.isfinite(self.f))
        return jnp.where(count > 0, count, len(self.f))


def empty_pool(x: Array) -> Pool:
    """A population of which nothing is known yet."""
    return Pool(x, jnp.full(len(x), jnp.inf))


def replace_generation(pool: Pool, elite: int, x: Array, f: Array) -> Pool:
    """The best `elite` members of the pool and all of the children x with costs f; of equals the older comes first."""
    return _sorted(jnp.concatenate([pool.x[:elite], x]), jnp.concatenate([pool.f[:elite], f]))


def replace_worst(pool: Pool, x: Array, f: Array) -> Pool:
    """Insert the children one after another, each in place of the worst member if it costs less and is no duplicate.

    That is the best n of pool and children together, so one sort does it: a child that equals a member pushed out
    before it costs as much as that member did, which is more than the worst left.
    """
    same = jnp.all(x[:, None] == pool.x[None], axis=2).any(axis=1)
    twins = jnp.tril(jnp.all(x[:, None] == x[None], axis=2), -1).any(axis=1)
    f = jnp.where(same | twins, jnp.inf, f)
    merged = _sorted(jnp.concatenate([pool.x, x]), jnp.concatenate([pool.f, f]))
    return Pool(merged.x[: len(pool.f)], merged.f[: len(pool.f)])


def _sorted(x: Array, f: Array) -> Pool:
    order = jnp.argsort(f, stable=True)
    return Pool(x[order], f[order])


def uniforms(key: Array, *shapes: tuple[int, ...]) -> list[Array]:
    """Independent uniform arrays of these shapes from one draw."""
    ends = list(accumulate(map(math.prod, shapes), initial=0))
    u = jax.random.uniform(key, (ends[-1],))
    return [u[i:j].reshape(shape) for (i, j), shape in zip(pairwise(ends), shapes, strict=True)]


def pick(u: Array, low: Array | int, high: Array | int) -> Array:
    """Uniform whole numbers in low..high-1, where the bounds may be data."""
    return jnp.minimum(low + jnp.floor(u * (high - low)).astype(int), high - 1)


def tournament(u: Array, size: int, alive: Array | int) -> Array:
    """Ranks of the winners of tournaments among `size` members drawn with replacement from the best `alive` ones.

    In a sorted population the winner has the least of `size` uniform ranks; the least of `size` uniform numbers is
    distributed as 1 - (1 - u)^(1/size), so one number decides a tournament.
    """
    least = -jnp.expm1(jnp.log1p(-u) / size)
    return jnp.minimum(jnp.floor(least * alive).astype(int), alive - 1)


def blend(u: Array, a: Array, b: Array, alpha: float) -> Array:
    """BLX-alpha: uniform between the parents and alpha times their distance beyond (Eshelman and Schaffer 1993,
    FOGA 2:187). May leave the cube."""
    wide = jnp.abs(a - b)
    return jnp.minimum(a, b) - alpha * wide + u * (1 + 2 * alpha) * wide


def simulated_binary(u: Array, a: Array, b: Array, eta: float) -> tuple[Array, Array]:
    """SBX: two children with the parents' mean, spread by beta (Deb and Agrawal 1995, Complex Systems 9:115).

    A coordinate is crossed with probability 1/2; which child gets which value is drawn for every coordinate. May leave
    the cube.
    """
    coin = jnp.floor(4 * u)  # two bits of u are coins, the others are uniform again
    u = 4 * u - coin
    beta = jnp.where(u <= 0.5, 2 * u, 0.5 / (1 - u)) ** (1 / (eta + 1))
    beta = jnp.where(coin < 2, beta, 1.0) * jnp.where(coin % 2 == 0, 1.0, -1.0)
    middle, half = (a + b) / 2, beta * (a - b) / 2
    return middle + half, middle - half


def polynomial_mutation(u: Array, z: Array, eta: float, rate: float) -> Array:
    """Every coordinate moves with probability `rate` by delta in (-1, 1), small ones likelier (Deb and Goyal 1996,
    Computer Science and Informatics 26:30). May leave the cube."""
    v = u / rate  # uniform in (0, 1) where u < rate, so that one number decides both
    power = jnp.where(v < 0.5, 2 * v, 2 * jnp.abs(1 - v)) ** (1 / (eta + 1))
    return z + jnp.where(u < rate, jnp.where(v < 0.5, power - 1, 1 - power), 0.0)


def reflect(z: Array) -> Array:
    """Points outside the cube mirrored at its sides."""
    inside = (z >= 0) & (z <= 1)
    return jnp.where(inside, z, 1 - jnp.abs(jnp.mod(z, 2.0) - 1))
