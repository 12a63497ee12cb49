"""Binary-coded genetic algorithm, plain or Gray code."""

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
    """The sorted population of chromosomes (n, d), one word of bits per coordinate, and the generation."""

    pool: Pool
    generation: Array


def encode(x: Array, bits: int, gray: bool) -> Array:
    """Cube points as words of `bits` bits, rounded to the nearest of the 2^bits levels."""
    level = jnp.round(x * (2**bits - 1)).astype(jnp.uint32)
    return level ^ (level >> 1) if gray else level


def decode(word: Array, bits: int, gray: bool) -> Array:
    """Words of `bits` bits as cube points; Gray code is undone by a running exclusive or from the top bit."""
    if gray:
        for shift in (1, 2, 4, 8, 16):
            word = word ^ (word >> shift)
    return word.astype(float) / (2**bits - 1)


def one_point(a: Array, b: Array, cut: Array, bits: int) -> Array:
    """Chromosomes (n, d) with the first `cut` (n, 1) of the d * bits bits from `a` and the rest from `b`."""
    taken = jnp.clip(cut - bits * jnp.arange(a.shape[1]), 0, bits)  # top bits of every word that come from a
    low = (jnp.uint32(1) << (bits - taken).astype(jnp.uint32)) - jnp.uint32(1)
    return (a & ~low) | (b & low)


def flip(word: Array, place: Array, bits: int) -> Array:
    """Chromosomes (n, d) with the bit at `place` (n, 1) of the d * bits turned over."""
    hit = place // bits == jnp.arange(word.shape[1])
    return word ^ jnp.where(hit, jnp.uint32(1) << (place % bits).astype(jnp.uint32), jnp.uint32(0))


@dataclass(frozen=True)
class BinaryGenetic:
    """Genetic algorithm on bit strings (Holland 1975, Adaptation in Natural and Artificial Systems; Gray code for it:
    Caruana and Schaffer 1988, ICML 5:153).

    Every coordinate is a word of `bits` bits, so answers lie on a grid of 2^bits levels (warm starts are rounded to
    it). Parents win tournaments, one-point crossover cuts the whole string, mutation turns one random bit, the best
    member survives without a new evaluation: a generation evaluates N - 1 points, also the first, in which the
    survivor's place is empty. Plain code stalls where neighbouring numbers differ in many bits (Hamming cliffs): on a
    5-D sphere it ends 7 decades above Gray code.

    Published rates such as "crossover 0.6, mutation 0.4" can be read in three ways. `rates` "individual": a child is
    crossed with one probability and mutated with the other. "fractions": a share `crossover_rate` of the children is
    crossed and not mutated, the rest are mutated copies (so the two rates add up to 1). The third reading, a
    probability per bit, turns 0.4 of all bits over and is no better than random search; it is not offered.
    """

    needs: ClassVar[Needs] = Needs()
    population: int = integer(50, 3, 100_000, "members, of which one survives a generation")
    bits: int = integer(16, 2, 30, "bits per coordinate")
    coding: str = choice(
        "gray", ("gray", "plain"), "gray: neighbouring numbers differ in one bit; plain: binary numbers"
    )
    rates: str = choice(
        "individual",
        ("individual", "fractions"),
        "what the two rates mean: probabilities for a child, or shares of the children",
    )
    crossover_rate: float = number(0.6, 0.0, 1.0, "probability that a child is crossed, or share of crossed children")
    mutation_rate: float = number(0.4, 0.0, 1.0, "probability that one bit of a child turns; not used with fractions")
    tournament: int = integer(2, 1, 100, "members that compete to be a parent")

    def rows(self, facts: Facts) -> int:
        return self.population - 1

    def init(self, key: Array, facts: Facts) -> Generation:
        words = jax.random.bits(key, (self.population, facts.dimension), jnp.uint32) >> (32 - self.bits)
        return Generation(operators.empty_pool(words), jnp.zeros((), int))

    def ask(self, key: Array, state: Generation) -> tuple[Array, Generation]:
        words = jnp.where(state.generation == 0, state.pool.x[1:], self._breed(key, state.pool))
        return decode(words, self.bits, self.coding == "gray"), state

    def _breed(self, key: Array, pool: Pool) -> Array:
        count, length = self.population - 1, self.bits * pool.x.shape[1]
        select, coin, cut, place = operators.uniforms(key, (2, count), (2, count, 1), (count, 1), (count, 1))
        winners = operators.tournament(select, self.tournament, pool.alive())
        a, b = pool.x[winners[0]], pool.x[winners[1]]
        if self.rates == "individual":
            crossed, mutated = coin[0] < self.crossover_rate, coin[1] < self.mutation_rate
        else:
            crossed = jnp.arange(count)[:, None] < round(self.crossover_rate * count)
            mutated = ~crossed
        child = jnp.where(crossed, one_point(a, b, operators.pick(cut, 1, length), self.bits), a)
        return jnp.where(mutated, flip(child, operators.pick(place, 0, length), self.bits), child)

    def tell(self, state: Generation, x: Array, f: Array) -> tuple[Generation, Info]:
        words = encode(x, self.bits, self.coding == "gray")
        return Generation(operators.replace_generation(state.pool, 1, words, f), state.generation + 1), {}
