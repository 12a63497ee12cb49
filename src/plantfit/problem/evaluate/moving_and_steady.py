"""Moving and steady records in one fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.batched import Batched
from plantfit.problem.evaluate.record_by_record import Direct

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Mixed:
    """`moving` records by chunks, the others by `still`; `counts` are the scored values of every record, in order.

    Pure functions of (z, (numbers, data)).
    """

    moving: Batched
    still: Direct
    counts: Mapping[str, int]

    @property
    def local_dimension(self) -> int:
        """Coordinates that the residuals of one recording are derived by."""
        return self.moving.local_dimension

    @cached_property
    def _order(self) -> np.ndarray:
        """Where the residuals of every record stand, in the order of the records, when the moving ones come first."""
        grouped = [*self.moving.names, *(n for n in self.counts if n not in self.moving.names)]
        begin = dict(zip(grouped, np.cumsum([0, *(self.counts[n] for n in grouped)])[:-1], strict=True))
        return np.concatenate([begin[n] + np.arange(self.counts[n]) for n in self.counts])

    def arguments(
        self, drives: Mapping[str, Any], scales: Mapping[str, float], data: Mapping[str, Any], weights: Mapping[str, float] | None
    ) -> Any:
        """The numbers of both."""
        rest = [n for n in self.counts if n not in self.moving.names]
        still = {**data, **{k: {n: data[k][n] for n in rest} for k in ("drive", "index", "measured")}}
        return self.moving.numbers(drives, scales, weights), still

    def _share(self) -> float:
        return sum(self.counts[n] for n in self.moving.names) / sum(self.counts.values())

    def costs(self, zs: Any, arguments: Any) -> Any:
        """Costs (n,) of cube points (n, d)."""
        share = self._share()
        return share * self.moving.costs(zs, arguments[0]) + (1.0 - share) * self.still.costs(zs, arguments[1])

    def values_and_gradients(self, zs: Any, arguments: Any) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""
        share = self._share()
        a, b = self.moving.values_and_gradients(zs, arguments[0]), self.still.values_and_gradients(zs, arguments[1])
        return jax.tree.map(lambda x, y: share * x + (1.0 - share) * y, a, b)

    def residuals(self, z: Any, arguments: Any) -> Any:
        """Scaled residuals (m,), recording by recording, output by output."""
        return jnp.concatenate([self.moving.residuals(z, arguments[0]), self.still.residuals(z, arguments[1])])[self._order]

    def residuals_and_jacobian(self, z: Any, arguments: Any) -> tuple[Any, Any]:
        """Residuals (m,) and dense derivatives (m, d)."""
        parts = self.moving.residuals_and_jacobian(z, arguments[0]), self.still.residuals_and_jacobian(z, arguments[1])
        r, jacobian = (jnp.concatenate(a)[self._order] for a in zip(*parts, strict=True))
        return r, jacobian

    def blocks(self, z: Any, arguments: Any) -> list[tuple[Any, Any]]:
        """For every moving record its residuals and derivatives by its own coordinates; then those of the others by all."""
        return [*self.moving.blocks(z, arguments[0]), self.still.residuals_and_jacobian(z, arguments[1])]

    @property
    def local(self) -> list[np.ndarray]:
        """Coordinates of every block."""
        return [*self.moving.local, np.arange(self.still.space.dimension)]
