"""A population method driven from inside a host method: restarts with other populations, trees of populations."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from plantfit.optimize.contract import Facts, Population
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.generations import Known, strong
from plantfit.runtime import jit

import jax
from jax import Array


@lru_cache(maxsize=128)
def _compiled(
    method: Population, rows: int, dimension: int
) -> tuple[Callable, Callable, Callable | None, Callable | None]:
    def ask(key: Array, state: Any, g: Array) -> tuple[Array, Any]:
        return method.ask(jax.random.fold_in(key, g), state)

    refresh, live = (getattr(method, name, None) for name in ("refresh", "live"))
    return jit(ask), jit(method.tell), refresh and jit(refresh), live and jit(live)


def _first(method: Population, facts: Facts, key: Array) -> Any:
    """The state before the first generation."""
    return jax.tree.map(strong, method.init(jax.random.fold_in(key, 2**31), facts))


@lru_cache(maxsize=128)
def _begin(method: Population, known: Known) -> Callable:
    """`_first`, compiled: one program is made in less time than one for every operation in it."""
    return jit(partial(_first, method, known.facts))


class Nested:
    """One population of a method. `state` may be read and replaced between generations.

    `best_x` (d,) and `best_cost` are the best of this population alone, `stopped` tells that its own rules ended it,
    `evaluations` what it spent. `facts.start` replaces rows of the first generation.
    """

    def __init__(self, method: Population, facts: Facts, key: Array):
        self.method, self.key, self.start = method, key, facts.start
        self.rows = method.rows(facts)
        self._ask, self._tell, self._refresh, self._live = _compiled(method, self.rows, facts.dimension)
        self._period = method.refresh_period(facts) if self._refresh is not None else 1  # pyrefly: ignore[missing-attribute]
        # with a point to begin from, what is compiled serves that point alone
        begin = partial(_first, method, facts) if facts.start is not None else _begin(method, Known(facts))
        self.state = begin(key)
        self.generations = self.evaluations = 0
        self.best_x, self.best_cost = np.full(facts.dimension, 0.5), np.inf
        self.stopped = False

    def generation(self, counter: Counter) -> tuple[np.ndarray, np.ndarray]:
        """Ask, evaluate, tell; the live candidates (n, d) and their costs (n,). Raises what the counter raises."""
        state = self.state
        if self._refresh is not None and self.generations % self._period == 0:
            state = self._refresh(state)
        n = self.rows if self._live is None else int(np.clip(self._live(state), 1, self.rows))
        asked, state = self._ask(self.key, state, self.generations)
        if self.start is not None and self.generations == 0:
            asked = np.concatenate([self.start[: self.rows], np.asarray(asked)[len(self.start) :]])
        x = np.asarray(asked)[:n]
        f = counter.costs(x)
        self.state, info = self._tell(state, asked, np.concatenate([f, np.full(self.rows - n, np.inf)]))
        self.generations += 1
        self.evaluations += n
        row = int(np.argmin(f))
        if f[row] < self.best_cost:
            self.best_x, self.best_cost = x[row].copy(), float(f[row])
        self.stopped = bool(info.get("stop", False)) or bool(info.get("stagnated", False))
        return x, f
