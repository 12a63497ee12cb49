"""Generations of a population method compiled apart from the cost, for searches of few generations.

A program of whole blocks (`generations.py`) spends no time between two generations, but is compiled anew, in some
seconds, for every cost. Here asking and telling serve all costs of as many coordinates, and only the costs of a
generation are compiled for a problem. The arithmetic is the same, and so are its bits.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, KeptCosts, Objective, Population
from plantfit.optimize.loop.generations import (
    BLOCK,
    RUNNING,
    Asked,
    Carry,
    Limits,
    Program,
    Scores,
    Steps,
    begin,
    parts_of,
    state_bytes,
)

import jax
from jax import Array

# a generation costs some 0.3 ms more apart, a program of blocks up to 4 s of compilation
FEW = 1000  # generations
SHORT = 20_000  # evaluations of a search
SMALL = 1 << 20  # bytes of all runs' states, which are copied between the parts


class Parts(NamedTuple):
    """The compiled functions of a generation: candidates, their costs, and what the method makes of them."""

    ask: Callable[..., Asked]
    evaluate: Callable[..., Array]
    tell: Callable[..., Carry]


def worth_it(method: Population, facts: Facts, width: int, groups: int) -> bool:
    """Whether a search of so many groups of `width` runs is quicker so, compilation included."""
    generations, evaluations = groups * (facts.budget // method.rows(facts)), groups * width * facts.budget
    return generations <= FEW and evaluations <= SHORT and width * state_bytes(method, facts) <= SMALL


def program_apart(objective: Objective, method: Population, facts: Facts) -> Program:
    """The same functions as those of `generations.program`."""
    steps, scores = parts_of(objective, method, facts)
    keep = scores.costs.keep_alone if isinstance(scores.costs, KeptCosts) else None
    ask, tell = _asking_and_telling(steps, facts.dimension, keep)
    return Program(begin(method, facts), partial(_advance, Parts(ask, _evaluating(scores), tell)))


@lru_cache(maxsize=32)
def _asking_and_telling(steps: Steps, dimension: int, keep: Callable | None) -> tuple[Callable, Callable]:
    """Of every cost with as many coordinates; `keep` makes functions that the next process finds again."""
    if keep is None:
        return jax.jit(steps.asked), jax.jit(steps.told)
    thing = steps.method, steps.rows, dimension, steps.period
    return keep(steps.asked, "asked", thing), keep(steps.told, "told", thing)


@lru_cache(maxsize=32)
def _evaluating(scores: Scores) -> Callable:
    if isinstance(scores.costs, KeptCosts):
        return scores.costs.keep(scores.evaluated, "evaluated", (scores.rows, scores.dimension))
    return jax.jit(scores.evaluated)


def _advance(
    parts: Parts,
    carry: Carry,
    keys: Array,
    start: Array,
    first: int,
    last: int,
    budget: int,
    target: float,
    patience: int,
    data: Any,
) -> tuple[Carry, np.ndarray, int]:
    """As `Generations.advance`; of no generation at all it compiles."""
    limits, history, g = Limits(budget, target, patience), np.zeros((BLOCK, len(keys), 2)), first

    def following(carry: Carry, g: int, counted: bool = True) -> Carry:
        asked = parts.ask(carry, keys, start, np.asarray(g))
        counts = asked.counts if counted else 0 * asked.counts
        return parts.tell(carry, asked, parts.evaluate(asked.x, counts, data), limits)

    if first == last:
        following(carry, g, counted=False)  # no candidate is simulated
    while g < last and np.any(np.asarray(carry.ending) == RUNNING):
        carry = following(carry, g)
        history[g - first] = np.stack([np.asarray(carry.evaluations, dtype=float), carry.best_f], axis=-1)
        g += 1
    return carry, history, g
