"""Runs of one population method with many values of its settings, side by side in one compiled program.

Settings are fields of a frozen method, so every new value would compile the loop anew. Here they travel as data
in the state of a run, and `TracedSettings` puts them back into the method wherever its pure functions are called.
Settings that decide shapes cannot travel so; `traceable` tells which can.
"""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Interrupted, SearchError
from plantfit.optimize.contract import CostOfData, Facts, Info, Needs, Objective, Population
from plantfit.optimize.loop.generations import BLOCK, PADDING, first_carry, program
from plantfit.optimize.loop.population_loop import SIDE_BY_SIDE

import jax
import jax.numpy as jnp
from jax import Array, lax

LANES = 16  # most runs side by side: one shape for any number of runs
BRANCHES = 8  # most combinations of words in one program
REPORT_SECONDS = 0.5

Values = tuple[Array, ...]
Options = tuple[tuple[str, tuple[str, ...]], ...]


class Job(NamedTuple):
    """Run number `run` with settings `values` as `TracedSettings.values` gives them."""

    values: tuple[float, ...]
    run: int


class Outcome(NamedTuple):
    """Final cost of a run, and evaluations and best cost (k,) after each of its generations."""

    cost: float
    history_evaluations: np.ndarray
    history_cost: np.ndarray


@dataclasses.dataclass(frozen=True)
class TracedSettings:
    """A population method whose settings are read from its state, (values, state of the template).

    `names` are numbers, passed as they are; `options` are words with the values they may take, passed as their
    index and compiled as branches. The loop maps over runs one by one, so that only the branch taken is run.
    """

    template: Any
    names: tuple[str, ...]
    options: Options = ()
    needs: ClassVar[Needs] = Needs()

    def values(self, method: Any) -> tuple[float, ...]:
        """The settings of a method as data."""
        numbers = tuple(getattr(method, n) for n in self.names)
        return numbers + tuple(words.index(getattr(method, n)) for n, words in self.options)

    def call(self, function: Callable, values: Values, *arguments: Any) -> Any:
        """function(method with these values, *arguments)."""
        numbers, chosen = dict(zip(self.names, values, strict=False)), values[len(self.names) :]
        combinations = list(itertools.product(*[words for _, words in self.options]))
        methods = [
            dataclasses.replace(self.template, **numbers, **dict(zip([n for n, _ in self.options], words, strict=True)))
            for words in combinations
        ]
        if len(methods) == 1:
            return function(methods[0], *arguments)
        index = jnp.ravel_multi_index(chosen, [len(words) for _, words in self.options], mode="clip")
        return lax.switch(index, [partial(function, m) for m in methods], *arguments)

    def rows(self, facts: Facts) -> int:
        return self.template.rows(facts)

    def ask(self, key: Array, state: tuple[Values, Any]) -> tuple[Array, tuple[Values, Any]]:
        values, inner = state
        x, inner = self.call(lambda m, k, s: m.ask(k, s), values, key, inner)
        return x, (values, inner)

    def tell(self, state: tuple[Values, Any], x: Array, f: Array) -> tuple[tuple[Values, Any], Info]:
        values, inner = state
        inner, info = self.call(lambda m, s, x, f: m.tell(s, x, f), values, inner, x, f)
        return (values, inner), info


class _Refreshing(TracedSettings):
    def refresh_period(self, facts: Facts) -> int:
        return self.template.refresh_period(facts)

    def refresh(self, state: tuple[Values, Any]) -> tuple[Values, Any]:
        values, inner = state
        return values, self.call(lambda m, s: m.refresh(s), values, inner)


class _Shrinking(TracedSettings):
    def live(self, state: tuple[Values, Any]) -> Array:
        return self.call(lambda m, s: m.live(s), *state)


class _RefreshingAndShrinking(_Refreshing, _Shrinking):
    pass


# the loop asks by name which of the optional functions a method has
_KINDS = {
    (False, False): TracedSettings,
    (True, False): _Refreshing,
    (False, True): _Shrinking,
    (True, True): _RefreshingAndShrinking,
}


class _Begun(NamedTuple):
    """A method with its values at hand, so that it can be initialised."""

    method: TracedSettings
    values: Values

    def init(self, key: Array, facts: Facts) -> tuple[Values, Any]:
        return self.values, self.method.call(lambda m, k: m.init(k, facts), self.values, key)


def traced(template: Population, names: Sequence[str], options: Options = ()) -> TracedSettings:
    """`template` with the settings `names` and `options` as data."""
    return _KINDS[hasattr(template, "refresh"), hasattr(template, "live")](template, tuple(names), options)


def traceable(
    template: Population, names: Sequence[str], options: Options, facts: Facts
) -> tuple[tuple[str, ...], Options]:
    """Those settings, of numbers and of words, that can be data: they decide no shape, and numbers no branch of
    Python."""
    numbers = [n for n in names if _traces(template, (n,), (), facts)]
    while numbers and not _traces(template, numbers, (), facts):
        numbers.pop()
    words: Options = ()
    for name, values in options:
        more = (*words, (name, values))
        few = math.prod(len(v) for _, v in more) <= BRANCHES
        if few and _traces(template, numbers, more, facts):
            words = more
    return tuple(numbers), words


def _traces(template: Population, names: Sequence[str], options: Options, facts: Facts) -> bool:
    """Whether every function of the method can be traced with these settings unknown."""
    if any(isinstance(getattr(template, n), bool) or not isinstance(getattr(template, n), int | float) for n in names):
        return False
    method: Any = traced(template, names, options)
    values = method.values(template)

    def alike(bound: Any, key: Array) -> Array:
        same = bound.rows(facts) == template.rows(facts)
        if isinstance(method, _Refreshing):
            same = same and bound.refresh_period(facts) == method.refresh_period(facts)
        if not same:
            raise TypeError("the shape of a generation depends on the setting")
        return jax.random.uniform(key)

    def generation(key: Array, values: Values) -> Any:
        method.call(alike, values, key)
        state = _Begun(method, values).init(key, facts)
        if isinstance(method, _Refreshing):
            state = method.refresh(state)
        if isinstance(method, _Shrinking):
            method.live(state)
        x, state = method.ask(key, state)
        return method.tell(state, x, jnp.zeros(len(x)))

    try:
        jax.eval_shape(generation, jax.random.key(0), tuple(_as_data(v) for v in values))
    except (
        TypeError,
        ValueError,
        IndexError,
        AttributeError,
        SearchError,
        jax.errors.JAXTypeError,
        jax.errors.JAXIndexError,
    ):
        return False
    return True


def _as_data(value: float) -> np.ndarray:
    return np.asarray(value, dtype=np.int64 if isinstance(value, int) else np.float64)


class Sweep:
    """Runs of one template on one objective, with any values of its settings `names` and `options`.

    A run has the random numbers of run number `run` of `minimise` with the same seed and settings and ends like it up
    to rounding (the compiler folds constants, not data); its bits do not depend on the runs beside it.
    Compiles once. Raises SearchError when the budget does not cover a generation.
    """

    def __init__(
        self, objective: Objective, template: Population, names: Sequence[str], options: Options, budget: int, seed: int
    ):
        self.objective, self.budget, self.seed = objective, budget, seed
        facts = Facts(objective.dimension, budget, objective.lower, objective.upper, objective.start)
        self.rows = template.rows(facts)
        if not template.needs.minimum_population <= self.rows <= budget:
            raise SearchError(
                f"A population of {self.rows} does not fit: the method needs at least "
                f"{template.needs.minimum_population} "
                f"and the budget of {budget} must cover one generation."
            )
        self.width = max(2, min(LANES, SIDE_BY_SIDE // self.rows))
        method: Any = traced(template, names, options)
        self.values = method.values
        self._advance = program(objective, method, facts).advance
        self._data = objective.costs.data if isinstance(objective.costs, CostOfData) else ()
        self._begin = jax.jit(
            lambda keys, values: lax.map(
                lambda kv: first_carry(_Begun(method, kv[1]), facts, kv[0]),  # pyrefly: ignore[bad-argument-type]
                (keys, values),
            )
        )
        start = np.zeros((0, facts.dimension)) if objective.start is None else np.clip(objective.start, 0.0, 1.0)
        self._start = jnp.asarray(start[: self.rows])

    def run(
        self,
        jobs: Sequence[Job],
        *,
        stop: Callable[[], bool] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> list[Outcome]:
        """Outcomes in the order of the jobs. `progress` hears evaluations as they are spent; `stop` raises
        Interrupted."""
        found: list[Outcome] = []
        for i in range(0, len(jobs), self.width):
            found += self._group(jobs[i : i + self.width], stop, progress)
        return found

    def _group(
        self, jobs: Sequence[Job], stop: Callable[[], bool] | None, progress: Callable[[float], None] | None
    ) -> list[Outcome]:
        members = len(jobs)
        filled = [*jobs, *[jobs[-1]] * (self.width - members)]
        keys = jax.vmap(lambda r: jax.random.fold_in(jax.random.key(self.seed), r))(
            jnp.asarray([j.run for j in filled], jnp.uint32)
        )
        values = tuple(
            np.stack([_as_data(v) for v in column]) for column in zip(*[j.values for j in filled], strict=True)
        )
        carry = self._begin(keys, values)
        carry = carry._replace(ending=jnp.where(jnp.arange(self.width) < members, carry.ending, PADDING))
        done, block, blocks, spent = 0, 1, [], 0.0
        while np.any(np.asarray(carry.ending) == 0):
            if stop is not None and stop():
                raise Interrupted("The search was stopped; what was finished is kept.")
            tick = time.perf_counter()
            upto = done + block
            carry, marks, reached = self._advance(
                carry, keys, self._start, done, upto, self.budget, -np.inf, 2**62, self._data
            )
            blocks.append(np.asarray(marks)[: int(reached) - done])
            done = int(reached)
            pace = REPORT_SECONDS / max(time.perf_counter() - tick, 1e-6)
            block = int(np.clip(block * min(max(pace, 0.25), 4.0), 1, BLOCK))
            now = float(np.sum(np.asarray(carry.evaluations)[:members]))
            if progress is not None:
                progress(now - spent)
            spent = now
        history, costs = np.concatenate(blocks), np.asarray(carry.best_f)
        return [Outcome(float(costs[k]), *history[:, k].T.copy()) for k in range(members)]
