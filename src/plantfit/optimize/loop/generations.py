"""Generations of a population method as compiled blocks: the carry of all runs, and the function that takes it on.

The key of generation g of a run is fold_in(key of the run, g), so any generation can be computed again from the carry
alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np

from plantfit.errors import SearchError
from plantfit.optimize.contract import CostOfData, Facts, KeptCosts, Objective, Population, Refreshing
from plantfit.runtime import jit

import jax
import jax.numpy as jnp
from jax import Array, lax

CHUNK = 64  # most candidates per evaluation
LANES = 16  # chunks are multiples of it
BLOCK = 256  # most generations between two looks at the clock
RUNNING, CONVERGED, STAGNATED, TARGET, BUDGET = range(5)  # how a run ended
PADDING = -1  # of rows that fill a group


class Carry(NamedTuple):
    """All runs of a group; leading axis: run. `ending` is one of the five above, or PADDING."""

    state: Any
    best_x: Array
    best_f: Array
    evaluations: Array
    improved_at: Array  # evaluations at the last improvement
    failures: Array
    ending: Array


class Limits(NamedTuple):
    """What ends runs: evaluations, a cost, and evaluations without a better one."""

    budget: Any
    target: Any
    patience: Any


class Given(NamedTuple):
    """What all generations of a group take: keys of the runs (runs,), points to begin from (k, d), limits, and data
    of the cost."""

    keys: Array
    start: Array
    limits: Limits
    data: Any


class Asked(NamedTuple):
    """A generation that awaits its costs: states, candidates x (runs, rows, d), and how many of each run count."""

    state: Any
    x: Array
    counts: Array


class Program(NamedTuple):
    """Compiled functions of one method on one cost."""

    begin: Callable
    advance: Callable


def chunk_of(rows: int) -> int:
    """Candidates per evaluation: the same for any number of runs, so that a run has the same bits in any company."""
    return min(CHUNK, -(-rows // LANES) * LANES)


def strong(a: Any) -> Array:
    """An array whose type does not give way: weak ones of a first state would make jax compile what follows a second
    time."""
    a = jnp.asarray(a)  # a plug-in may begin with a plain number
    return lax.convert_element_type(a, a.dtype)


def first_carry(method: Population, facts: Facts, key: Array) -> Carry:
    """One run before its first generation; `key` is that of the run."""
    zero = jnp.zeros((), int)
    state = method.init(jax.random.fold_in(key, 2**31), facts)
    return jax.tree.map(
        strong, Carry(state, jnp.full(facts.dimension, 0.5), jnp.asarray(jnp.inf), zero, zero, zero, zero)
    )


def program(objective: Objective, method: Population, facts: Facts) -> Program:
    """The compiled functions, reused by every search with the same cost, settings and shapes."""
    return Program(begin(method, facts), _compiled(Generations(*parts_of(objective, method, facts))))


def parts_of(objective: Objective, method: Population, facts: Facts) -> "tuple[Steps, Scores]":
    """What a generation is made of: what the method does, and what the cost does."""
    period, rows, costs = getattr(method, "refresh_period", None), method.rows(facts), objective.costs
    function, of_data = (costs.function, True) if isinstance(costs, CostOfData) else (costs, False)
    steps = Steps(method, rows, None if period is None else period(facts))
    return steps, Scores(function, of_data, rows, facts.dimension)


def begin(method: Population, facts: Facts) -> Callable:
    """The compiled function that makes the first carry from the keys of the runs."""
    return _begin(method, Known(facts))


class Known:
    """Facts that are equal where their numbers are, so that what is traced from them is found again."""

    def __init__(self, facts: Facts):
        self.facts = Facts(facts.dimension, facts.budget, *(None if a is None else np.array(a) for a in facts[2:]))
        self._key = (
            facts.dimension,
            facts.budget,
            *(None if a is None else (a.shape, a.dtype, a.tobytes()) for a in self.facts[2:]),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Known) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def state_bytes(method: Population, facts: Facts) -> int:
    """Bytes of all that one run carries from generation to generation."""
    return _state_bytes(method, Known(facts))


@lru_cache(maxsize=32)
def _state_bytes(method: Population, known: Known) -> int:
    carry = jax.eval_shape(partial(first_carry, method, known.facts), jax.random.key(0))
    return sum(a.size * a.dtype.itemsize for a in jax.tree.leaves(carry))


@lru_cache(maxsize=32)
def _begin(method: Population, known: Known) -> Callable:
    return jit(lambda keys: lax.map(partial(first_carry, method, known.facts), keys))


@lru_cache(maxsize=32)
def _compiled(generations: "Generations") -> Callable:
    """The compiled function; of costs that say how, one that the next process finds again."""
    costs, steps = generations.scores.costs, generations.steps
    if isinstance(costs, KeptCosts):
        rest = steps.method, steps.rows, generations.scores.dimension, steps.period
        return costs.keep(generations.advance, "generations", rest)
    return jax.jit(generations.advance)


def _mapped_beside(function: Callable[[Any, Any], tuple[Any, Any]], given: Any, state: Any) -> tuple[Any, Any]:
    """`lax.map` of `function(given, state) -> (found, state)`, in which what stays as it is in the state is not copied
    out run by run: matrices of a covariance take longer to copy than to use."""
    changes: list[bool] = []

    def one(both: Any) -> tuple[Any, list[Any]]:
        found, after = function(*both)
        pairs = list(zip(jax.tree.leaves(both[1]), jax.tree.leaves(after), strict=True))
        changes[:] = [new is not old for old, new in pairs]
        return found, [new for old, new in pairs if new is not old]

    found, changed = lax.map(one, (given, state))
    leaves, tree = jax.tree.flatten(state)
    changing = iter(changed)
    return found, jax.tree.unflatten(tree, [next(changing) if c else a for a, c in zip(leaves, changes, strict=True)])


def _mapped(function: Callable[[Any], Any], state: Any) -> Any:
    """`lax.map(function, state)`, copied likewise."""
    return _mapped_beside(lambda _, s: ((), function(s)), (), state)[1]


@dataclass(frozen=True)
class Steps:
    """What a method does in a generation, whatever the cost: it asks for candidates, and is told their costs."""

    method: Population
    rows: int  # candidates of a generation
    period: int | None  # generations between two calls of the method's `refresh`

    def asked(self, carry: Carry, keys: Array, start: Array, g: Array) -> Asked:
        """What generation g asks for."""
        state = carry.state
        if self.period is not None:
            refresh = cast(Refreshing, self.method).refresh
            state = lax.cond(g % self.period == 0, partial(_mapped, refresh), lambda s: s, state)
        counts = jnp.where(carry.ending == RUNNING, self._due(state, len(keys)), 0)
        x, state = _mapped_beside(lambda key, s: self.method.ask(jax.random.fold_in(key, g), s), keys, state)
        if start.shape[0]:
            x = jnp.where(g == 0, x.at[:, : start.shape[0]].set(start), x)
        return Asked(state, x, counts)

    def told(self, carry: Carry, asked: Asked, f: Array, limits: Limits) -> Carry:
        """The carry after the generation that was asked for and has the costs f (runs, rows)."""
        active = carry.ending == RUNNING
        state, info = lax.map(lambda told: self.method.tell(*told), (asked.state, asked.x, f))
        new = self._counted(carry._replace(state=state), asked.x, f, asked.counts, info, limits)
        return jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), new, carry)

    def _due(self, state: Any, runs: int) -> Array:
        """Evaluations (runs,) of the next generation."""
        live = getattr(self.method, "live", None)
        return jnp.full(runs, self.rows) if live is None else jnp.clip(jax.vmap(live)(state), 1, self.rows)

    def _counted(
        self, carry: Carry, x: Array, f: Array, counts: Array, info: dict[str, Array], limits: Limits
    ) -> Carry:
        """The carry with the best of candidates x (runs, rows, d) of costs f (runs, rows), and how runs end with
        them."""
        no = jnp.zeros(len(counts), bool)
        row = jnp.argmin(f, axis=1)
        lowest = jnp.take_along_axis(f, row[:, None], axis=1)[:, 0]
        better = lowest < carry.best_f
        best_f = jnp.where(better, lowest, carry.best_f)
        best_x = jnp.where(better[:, None], jnp.take_along_axis(x, row[:, None, None], axis=1)[:, 0], carry.best_x)
        evaluations = carry.evaluations + counts
        improved_at = jnp.where(better, evaluations, carry.improved_at)
        stale = info.get("stagnated", no) | (evaluations - improved_at >= limits.patience)
        spent = evaluations + self._due(carry.state, len(counts)) > limits.budget
        ends = [best_f <= limits.target, info.get("stop", no), stale, spent]
        ending = jnp.select(ends, [TARGET, CONVERGED, STAGNATED, BUDGET], RUNNING)
        failures = carry.failures + counts - jnp.sum(jnp.isfinite(f), axis=1)
        return Carry(carry.state, best_x, best_f, evaluations, improved_at, failures, ending)


@dataclass(frozen=True)
class Scores:
    """Costs of the candidates of a generation; with `of_data` they take data beside them."""

    costs: Callable
    of_data: bool
    rows: int
    dimension: int

    def evaluated(self, x: Array, counts: Array, data: Any) -> Array:
        """Costs (runs, rows) of the first `counts` candidates of each run, +inf for the others."""
        flat, size = x.reshape(-1, self.dimension), chunk_of(self.rows)
        live = (jnp.arange(self.rows) < counts[:, None]).reshape(-1)
        place = jnp.cumsum(live) - 1
        padded = -(-len(flat) // size) * size
        source = jnp.zeros(padded, int).at[jnp.where(live, place, padded)].set(jnp.arange(len(flat)), mode="drop")

        def chunk(i: Array, f: Array) -> Array:
            return f.at[i].set(self._chunk_costs(flat[lax.dynamic_slice_in_dim(source, i * size, size)], data))

        # a loop whose length is data: XLA compiles one body, so a run has the same bits in any company
        f = lax.fori_loop(0, -(-jnp.sum(live) // size), chunk, jnp.full((padded // size, size), jnp.inf))
        f = jnp.where(live, f.reshape(-1)[place], jnp.inf).reshape(x.shape[:2])
        return jnp.where(jnp.isfinite(f), f, jnp.inf)

    def _chunk_costs(self, x: Array, data: Any) -> Array:
        f = self.costs(x, data) if self.of_data else self.costs(x)
        if f.shape != (len(x),):
            raise SearchError(
                f"The cost returned shape {f.shape} for {len(x)} candidates; it must return one cost for each."
            )
        return f


@dataclass(frozen=True)
class Generations:
    """Generations of one method on one cost, as one program."""

    steps: Steps
    scores: Scores

    def advance(
        self,
        carry: Carry,
        keys: Array,
        start: Array,
        first: Array,
        last: Array,
        budget: Array,
        target: Array,
        patience: Array,
        data: Any,
    ) -> tuple[Carry, Array, Array]:
        """Run generations first..last-1: the carry, a history, and the generation that was reached.

        The history (BLOCK, runs, 2) holds evaluations and best cost after each generation; the generation reached is
        less than `last` when all runs have ended. The number of generations is data, not shape, so that results cannot
        depend on how blocks are cut.
        """
        given = Given(keys, start, Limits(budget, target, patience), data)

        def step(loop):
            carry, history, g = loop
            carry = self._generation(carry, g, given)
            mark = jnp.stack([carry.evaluations.astype(float), carry.best_f], axis=-1)
            return carry, lax.dynamic_update_index_in_dim(history, mark, g - first, 0), g + 1

        def going(loop):
            return (loop[2] < last) & jnp.any(loop[0].ending == RUNNING)

        return lax.while_loop(going, step, (carry, jnp.zeros((BLOCK, len(keys), 2)), first))

    def _generation(self, carry: Carry, g: Array, given: Given) -> Carry:
        """The carry after generation g."""
        asked = self.steps.asked(carry, given.keys, given.start, g)
        return self.steps.told(carry, asked, self.scores.evaluated(asked.x, asked.counts, given.data), given.limits)
