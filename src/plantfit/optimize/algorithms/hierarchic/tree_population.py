"""Populations of a tree: each searches by a method of its own and remembers where it has been."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.cmaes import CmaEs
from plantfit.optimize.algorithms.cma_es.dd_cmaes import DecodingCmaEs
from plantfit.optimize.algorithms.genetic.sea import SimpleEvolution, mirrored
from plantfit.optimize.contract import Facts, Population
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.generations import strong
from plantfit.optimize.loop.nested import Nested

import jax
import jax.numpy as jnp
from jax import Array

MANY = 100  # parameters, as in `auto`


@dataclass(frozen=True)
class Level:
    """What the populations of one level do: `generations` of `method` per metaepoch; `place(state, seed, step, key)`
    moves a fresh state to a seed."""

    method: Population
    generations: int
    place: Callable[[Any, np.ndarray, float, Array], Any]


class Deme:
    """One population: its points and costs so far, whether it is still active, and the mean cost of every metaepoch."""

    def __init__(
        self, level: int, kind: Level, facts: Facts, key: Array, seed: np.ndarray | None = None, step: float = 0.0
    ):
        self.level, self.kind, self.seed = level, kind, seed
        self.nested = Nested(kind.method, facts, key)
        if seed is not None:
            placed = kind.place(self.nested.state, seed, step, jax.random.fold_in(key, 2**30))
            self.nested.state = jax.tree.map(strong, placed)  # as a state that was told: compiled once for both
        self.active = True
        self.means: list[float] = []
        self._points: list[np.ndarray] = []
        self._costs: list[np.ndarray] = []

    @property
    def points(self) -> np.ndarray:
        """Every point (n, d) that was evaluated here."""
        return np.concatenate(self._points) if self._points else np.zeros((0, len(self.nested.best_x)))

    @property
    def costs(self) -> np.ndarray:
        """Their costs (n,)."""
        return np.concatenate(self._costs) if self._costs else np.zeros(0)

    @property
    def best_cost(self) -> float:
        return self.nested.best_cost

    @property
    def individuals(self) -> tuple[np.ndarray, np.ndarray]:
        """The present population (n, d) and its costs (n,)."""
        return np.asarray(self.nested.state.x), np.asarray(self.nested.state.f)

    @property
    def centre(self) -> np.ndarray:
        """Mean (d,) of the distribution, else of the individuals."""
        state = self.nested.state
        return np.asarray(state.mean) if hasattr(state, "mean") else np.mean(np.asarray(state.x), axis=0)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (d, d) of the distribution, else of the individuals."""
        state = self.nested.state
        if hasattr(state, "cov"):
            return np.asarray(state.sigma) ** 2 * np.asarray(state.cov)
        return np.atleast_2d(np.cov(np.asarray(state.x), rowvar=False))

    def metaepoch(self, counter: Counter) -> None:
        """The generations of one metaepoch; ends early and inactive when the method's own rules stop it."""
        costs = np.zeros(0)
        for _ in range(self.kind.generations):
            before = self.nested.state
            x, costs = self.nested.generation(counter)
            self._points.append(x)
            self._costs.append(costs)
            if self.nested.stopped:
                # a method that ends may already have begun anew inside; the tree needs where it was
                self.active, self.nested.state = False, before
                break
        finite = costs[np.isfinite(costs)]
        self.means.append(float(np.mean(finite)) if len(finite) else np.inf)

    def settled(self, window: int, tolerance: float) -> bool:
        """Whether the mean costs of the last `window` metaepochs differ by less than `tolerance` of the interquartile
        range of all costs so far; also when nothing could be simulated in them."""
        last = np.asarray(self.means[-window:])
        if len(last) < window:
            return False
        if not np.all(np.isfinite(last)):
            return not np.any(np.isfinite(last))
        costs = self.costs
        low, high = np.quantile(costs[np.isfinite(costs)], [0.25, 0.75])
        return bool(np.mean(last) - np.min(last) <= tolerance * (high - low))


def explorers(population: int | None, mutation: float) -> Level:
    """Evolution whose steps never shrink; as a child it begins as a cloud around its seed."""

    def place(state: Any, seed: np.ndarray, step: float, key: Array) -> Any:
        x = mirrored(jnp.asarray(seed) + step * jax.random.normal(key, state.x.shape))
        return state._replace(x=x.at[0].set(seed))

    return Level(SimpleEvolution(population=population, mutation=mutation, steps="fixed"), 1, place)


def climbers(dimension: int, population: int | None, generations: int) -> Level:
    """CMA-ES from the seed, from MANY parameters on the one that learns scales first; no restarts: the tree decides
    where to go on."""

    def place(state: Any, seed: np.ndarray, step: float, key: Array) -> Any:
        return state._replace(mean=jnp.asarray(seed), sigma=jnp.asarray(step), first=jnp.asarray(step))

    method = DecodingCmaEs if dimension > MANY else CmaEs
    return Level(method(population=population, restarts=0), generations, place)
