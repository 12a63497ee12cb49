"""Moving and steady records in one fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.batched import BatchedRecords
from plantfit.problem.evaluate.record_by_record import RecordByRecord

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class MovingAndSteady:
    """`moving` records by chunks, the others one by one; `counts` are the scored values of every record, in order.

    Pure functions of (z, (numbers, data)).
    """

    moving: BatchedRecords
    steady: RecordByRecord
    counts: Mapping[str, int]

    @property
    def local_dimension(self) -> int:
        """Coordinates that the residuals of one recording are derived by."""
        return self.moving.local_dimension

    @cached_property
    def _order(self) -> np.ndarray:
        """Where the residuals of every record stand, in the order of the records, when the moving ones come first."""
        grouped = [*self.moving.names, *self._others]
        begin = dict(zip(grouped, np.cumsum([0, *(self.counts[n] for n in grouped)])[:-1], strict=True))
        return np.concatenate([begin[n] + np.arange(self.counts[n]) for n in self.counts])

    @property
    def _others(self) -> tuple[str, ...]:
        return tuple(n for n in self.counts if n not in self.moving.names)

    @property
    def recordings(self) -> list[tuple[str, ...]]:
        """Every moving recording by itself, then all others together."""
        return [*self.moving.recordings, self._others]

    @property
    def compiled_in(self) -> Any:
        """That of both, and how many rows every record has."""
        return self.moving.compiled_in, self.steady.compiled_in, dict(self.counts)

    def arguments(self, data: Mapping[str, Any]) -> Any:
        """The numbers of the moving records, and the data of the others."""
        steady = {**data, **{k: {n: data[k][n] for n in self._others} for k in ("drive", "index", "measured")}}
        with jax.ensure_compile_time_eval():
            return self.moving.arguments(data), jax.device_put(steady)

    def _share(self) -> float:
        return sum(self.counts[n] for n in self.moving.names) / sum(self.counts.values())

    def costs(self, zs: Any, arguments: Any) -> Any:
        """Costs (n,) of cube points (n, d)."""
        share = self._share()
        return share * self.moving.costs(zs, arguments[0]) + (1.0 - share) * self.steady.costs(zs, arguments[1])

    def values_and_gradients(self, zs: Any, arguments: Any) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""
        share = self._share()
        a, b = self.moving.values_and_gradients(zs, arguments[0]), self.steady.values_and_gradients(zs, arguments[1])
        return jax.tree.map(lambda x, y: share * x + (1.0 - share) * y, a, b)

    def residuals(self, z: Any, arguments: Any) -> Any:
        """Scaled residuals (m,), recording by recording, output by output."""
        return jnp.concatenate([self.moving.residuals(z, arguments[0]), self.steady.residuals(z, arguments[1])])[
            self._order
        ]

    def residuals_and_jacobian(self, z: Any, arguments: Any) -> tuple[Any, Any]:
        """Residuals (m,) and dense derivatives (m, d)."""
        parts = self.moving.residuals_and_jacobian(z, arguments[0]), self.steady.residuals_and_jacobian(z, arguments[1])
        r, jacobian = (jnp.concatenate(a)[self._order] for a in zip(*parts, strict=True))
        return r, jacobian

    def blocks(self, z: Any, arguments: Any) -> list[tuple[Any, Any]]:
        """For every moving record its residuals and derivatives by its own coordinates; then those of the others by
        all."""
        return [*self.moving.blocks(z, arguments[0]), self.steady.residuals_and_jacobian(z, arguments[1])]

    def only(self, arguments: Any, wanted: np.ndarray) -> Any:
        """Records that move may be left out."""
        return self.moving.only(arguments[0], wanted[:-1]), arguments[1]

    @property
    def local(self) -> list[np.ndarray]:
        """Coordinates of every block."""
        return [*self.moving.local, np.arange(self.steady.space.dimension)]
