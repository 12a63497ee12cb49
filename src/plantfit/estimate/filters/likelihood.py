"""The likelihood of recordings by the prediction errors of a Kalman filter, with exact first and second derivatives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.filter_step import Spread, filter_step
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.state_space import Record, StateSpace, state_space
from plantfit.native import native_scan
from plantfit.problem.problem import Problem
from plantfit.space import Space

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Innovations:
    """Minus the log-likelihood of records as a function of a cube point (d,): parameters of the problem, then free
    noise levels.

    Each measurement's density given those before it is normal with the filter's prediction and variance: for a linear
    model exactly (Schweppe, IEEE Trans. Information Theory 11 (1965) 61, eq. (14)), else as nearly as the filter is.
    Derivatives are carried through the recursion beside the belief, forwards, as one native loop over the directions.
    """

    plants: tuple[StateSpace, ...]
    spread: Spread
    initial: np.ndarray  # (n,) standard deviations at the first sample

    @classmethod
    def of(cls, problem: Problem, noise: Noise, spread: Spread) -> "Innovations":
        """Over the recordings of the problem that have a fitted part."""
        fitted = [n for n, e in problem.experiments.items() if np.any(e.mask("fit"))]
        plants = tuple(state_space(problem, noise, (), n) for n in fitted)
        return cls(plants, spread, np.diag(noise.initial_levels(plants[0].model)))

    def records(self, problem: Problem) -> tuple[Record, ...]:
        """The numbers of a problem like the one that this was made of."""
        return tuple(p.record(problem, problem.experiments[str(p.recording)], fitted=True) for p in self.plants)

    @property
    def space(self) -> Space:
        return self.plants[0].space

    @cached_property
    def value(self) -> Callable:
        """(z, records) -> minus the log-likelihood."""

        def total(z: Any, records: Sequence[Record]) -> Any:
            return sum(
                self._scanned(self._begin(p, r)(z), self._body(p), keep=False)[0][1]
                for p, r in zip(self.plants, records, strict=True)
            )

        return jax.jit(total)

    @cached_property
    def values_and_gradients(self) -> Callable:
        """(z, records) -> minus the log-likelihood and its gradient (d,)."""
        return jax.jit(lambda z, records: self._first(z, records, keep=False))

    @cached_property
    def scores(self) -> Callable:
        """(z, records) -> per record the gradient of every row's share, (rows, d)."""
        return jax.jit(lambda z, records: self._first(z, records, keep=True))

    @cached_property
    def hessian(self) -> Callable:
        """(z, records) -> second derivatives (d, d) of minus the log-likelihood."""

        def second(z: Any, records: Sequence[Record]) -> Any:
            d = self.space.dimension
            i, j = np.triu_indices(d)
            total = sum(
                (self._second(p, r, z, i, j) for p, r in zip(self.plants, records, strict=True)), jnp.zeros(len(i))
            )
            full = jnp.zeros((d, d)).at[i, j].set(total)
            return full + jnp.triu(full, 1).T

        return jax.jit(second)

    def _first(self, z: Any, records: Sequence[Record], keep: bool) -> Any:
        each = [self._along_axes(p, r, z, keep) for p, r in zip(self.plants, records, strict=True)]
        if keep:
            return tuple(told.T for _, _, told in each)
        return sum(value for value, _, _ in each), sum(slope for _, slope, _ in each)

    def _along_axes(self, plant: StateSpace, record: Record, z: Any, keep: bool) -> tuple[Any, Any, Any]:
        """One record's value, gradient (d,) and with `keep` every row's gradient (d, rows)."""
        begin, body = self._begin(plant, record), _pushed(self._body(plant))

        def along(a):
            (carry, moved), told = self._scanned(_crossed(jax.jvp(begin, (z,), (a,))), body, keep=keep)
            return carry[1], moved[1], told[1] if keep else None

        value, slope, told = jax.vmap(along)(jnp.eye(self.space.dimension))
        return value[0], slope, told

    def _second(self, plant: StateSpace, record: Record, z: Any, i: np.ndarray, j: np.ndarray) -> Any:
        """One record's second derivatives (q,) by coordinates i and j."""
        begin, body = self._begin(plant, record), _pushed(_pushed(self._body(plant)))

        def along(a, b):
            value, moved = jax.jvp(lambda z: jax.jvp(begin, (z,), (a,)), (z,), (b,))
            (_, moved), _ = self._scanned(_crossed((_crossed(value), _crossed(moved))), body, keep=False)
            return moved[1][1]

        axes = jnp.eye(self.space.dimension)
        return jax.vmap(along)(axes[i], axes[j])

    def _begin(self, plant: StateSpace, record: Record) -> Callable:
        """z -> constants, carry (belief, minus log-likelihood so far), rows."""

        def begin(z):
            values = self.space.physical(z)
            root = jnp.asarray(self.initial)
            return (
                plant.constants(values),
                ((plant.first(values, record.drive), root), jnp.zeros(())),
                plant.rows(values, record)[0],
            )

        return begin

    def _body(self, plant: StateSpace) -> Callable:
        def body(c, carry, row):
            belief, told = filter_step(plant, self.spread, False, c, carry[0], row)
            own = -told["log_likelihood"]
            return (belief, carry[1] + own), own

        return body

    @staticmethod
    def _scanned(start: Any, body: Callable, keep: bool) -> Any:
        constants, carry, rows = start
        return native_scan(lambda carry, row: body(constants, carry, row), carry, rows, keep=keep, fallback=True)


def _pushed(body: Callable) -> Callable:
    """The body on pairs (value, derivative), derivative by derivative."""

    def both(constants, carry, row):
        primal, tangent = zip(constants, carry, row, strict=True)
        (carry, told), (carry_moved, told_moved) = jax.jvp(body, primal, tangent)
        return (carry, carry_moved), (told, told_moved)

    return both


def _crossed(start: Any) -> Any:
    """((constants, carry, rows), their derivatives) to (constants, carry, rows) of pairs."""
    return tuple(zip(*start, strict=True))
