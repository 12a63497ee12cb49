"""Curvature regularisation: bends of tables as further residuals of a problem.

    cost(z) = (sum of squared scaled residuals + sum over tables and axes of strength x sum of squared bends) / m
    (1)

with m scored samples and the bends of `second_differences`. A bend with standard deviation s (in box widths) as prior
belief is strength = sigma^2/s^2, sigma that of a scaled residual (Tikhonov; Wahba, Spline Models for Observational
Data, 1990, eq. 1.5.2).
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import Table
from plantfit.problem.evaluate.evaluator import Evaluator
from plantfit.problem.evaluate.second_differences import Bends, bends_of
from plantfit.space import Space

import jax.numpy as jnp

Key = tuple[str, str]  # parameter, and the signal along whose axis it bends
# of the outputs' spread: the residual beside which a bend over the whole box weighs, while the strength is not chosen
# yet
WEAK = 0.01


@dataclass(frozen=True, eq=False)
class Smoothing:
    """What is smoothed in a cube of `dimension`, and how strongly; `asked` says how strengths are to be chosen that
    are not given."""

    dimension: int
    bends: tuple[Bends, ...]
    strengths: Mapping[Key, float]
    asked: Mapping[str, str]

    @classmethod
    def of(cls, space: Space, tables: Mapping[str, Table], spread: float) -> "Smoothing | None":
        """That which the parameters ask for; None without. `spread` is that of the scaled outputs (rms)."""
        bends = tuple(bends_of(space, tables))
        if not bends:
            return None
        strengths, asked = {}, {}
        for b in bends:
            given = space.parameters[b.parameter].smooth
            if isinstance(given, str):
                asked[b.parameter], strengths[b.parameter, b.signal] = given, (WEAK * spread) ** 2
            else:
                values = np.atleast_1d(np.asarray(given, dtype=float))
                strengths[b.parameter, b.signal] = float(values[b.axis if len(values) > 1 else 0])
        return cls(space.dimension, bends, strengths, asked)

    def with_strengths(self, strengths: Mapping[Key, float]) -> "Smoothing":
        """The same with some strengths changed."""
        return dataclasses.replace(self, strengths={**self.strengths, **strengths})

    @property
    def keys(self) -> tuple[Key, ...]:
        return tuple(self.strengths)

    @cached_property
    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bends of all as rows @ z + offset: rows (K, d), offset (K,), and the place (K,) of each one's strength in
        `keys`."""
        rows = np.zeros((sum(len(b.rows) for b in self.bends), self.dimension))
        offset, key, start = np.zeros(len(rows)), np.zeros(len(rows), dtype=int), 0
        for b in self.bends:
            here = slice(start, start + len(b.rows))
            rows[here, b.columns], offset[here], key[here] = b.rows, b.offset, self.keys.index((b.parameter, b.signal))
            start = here.stop
        return rows, offset, key

    @property
    def weights(self) -> np.ndarray:
        """Strength of every bend (K,)."""
        return np.array(list(self.strengths.values()))[self.rows[2]]

    @property
    def tables(self) -> tuple[tuple[np.ndarray, int], ...]:
        """For every smoothed table the places (q,) of its entries, and how many dimensions of it have no bends
        (lines, planes)."""
        found: dict[bytes, list[Bends]] = {}
        for b in self.bends:
            found.setdefault(b.columns.tobytes(), []).append(b)
        made = []
        for own in found.values():
            seen = [b.rows for b in own if self.strengths[b.parameter, b.signal] > 0]
            rank = int(np.linalg.matrix_rank(np.concatenate(seen))) if seen else 0
            made.append((own[0].columns, len(own[0].columns) - rank))
        return tuple(made)

    @property
    def matrix(self) -> np.ndarray:
        """Sum of strength x row' row (d, d): what smoothing adds to J'J."""
        rows = self.rows[0]
        return rows.T @ (self.weights[:, None] * rows)

    def weighted(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bends times the roots of their strengths (K,) at a cube point (d,), and their derivatives (K, d)."""
        rows, offset, _ = self.rows
        root = np.sqrt(self.weights)
        return root * (rows @ z + offset), root[:, None] * rows


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Pure functions of (z, (arguments of `data`, strengths (L,))): those of `data`, the bends after its rows.

    Rows are scaled so that their mean square stays the cost (1); bends stand at the end, in `blocks` at the end of the
    first block that has their coordinates.
    """

    data: Evaluator
    smoothing: Smoothing
    count: int  # m of eq. (1)

    @property
    def local_dimension(self) -> int:
        """Coordinates that the residuals of one recording are derived by."""
        return self.data.local_dimension

    @property
    def local(self) -> Any:
        """Coordinates of every block."""
        return self.data.local

    @property
    def recordings(self) -> Any:
        """As those of `data`."""
        return self.data.recordings

    @property
    def compiled_in(self) -> Any:
        """That of `data`, and the bends; their strengths are arguments."""
        return self.data.compiled_in, self.smoothing.rows, self.count

    def arguments(self, data: Mapping[str, Any]) -> Any:
        """Those of `data`, and the strengths."""
        return self.data.arguments(data), np.array(list(self.smoothing.strengths.values()))

    def _bends(self, zs: Any, strengths: Any) -> tuple[Any, Any]:
        """Of cube points (..., d): bends (..., K) times the roots of their strengths, and these roots (K,)."""
        rows, offset, key = self.smoothing.rows
        root = jnp.sqrt(strengths)[key]
        return (zs @ rows.T + offset) * root, root

    def costs(self, zs: Any, arguments: Any) -> Any:
        """Costs (n,) of cube points (n, d)."""
        bends, _ = self._bends(zs, arguments[1])
        return self.data.costs(zs, arguments[0]) + jnp.sum(bends**2, axis=-1) / self.count

    def values_and_gradients(self, zs: Any, arguments: Any) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""
        f, g = self.data.values_and_gradients(zs, arguments[0])
        bends, root = self._bends(zs, arguments[1])
        more = (bends * root) @ self.smoothing.rows[0]
        return f + jnp.sum(bends**2, axis=-1) / self.count, g + 2.0 * more / self.count

    def residuals(self, z: Any, arguments: Any) -> Any:
        """Scaled residuals, then bends (m + K,)."""
        r, bends = self.data.residuals(z, arguments[0]), self._bends(z, arguments[1])[0]
        return jnp.concatenate([r, bends]) * self._stretch(r.shape[0])[0]

    def residuals_and_jacobian(self, z: Any, arguments: Any) -> tuple[Any, Any]:
        """The same with their derivatives (m + K, d)."""
        r, jacobian = self.data.residuals_and_jacobian(z, arguments[0])
        bends, root = self._bends(z, arguments[1])
        stretch = self._stretch(r.shape[0])[0]
        return jnp.concatenate([r, bends]) * stretch, jnp.concatenate(
            [jacobian, root[:, None] * self.smoothing.rows[0]]
        ) * stretch

    def blocks(self, z: Any, arguments: Any) -> list[tuple[Any, Any]]:
        """For every block of `data` its rows and its bends, by its own coordinates."""
        blocks = self.data.blocks(z, arguments[0])
        bends, root = self._bends(z, arguments[1])
        for_data, for_bends = self._stretch(sum(r.shape[0] for r, _ in blocks))
        made = []
        for (r, jacobian), own, here in zip(blocks, self.local, self._owners(), strict=True):
            slopes = root[here][:, None] * self.smoothing.rows[0][np.ix_(here, own)]
            made.append(
                (
                    jnp.r_[r * for_data, bends[here] * for_bends],
                    jnp.concatenate([jacobian * for_data, slopes * for_bends]),
                )
            )
        return made

    def only(self, arguments: Any, wanted: np.ndarray) -> Any:
        """Those of `data`, and the strengths."""
        return self.data.only(arguments[0], wanted), arguments[1]

    def _owners(self) -> list[np.ndarray]:
        """The bends (k,) of every block."""
        left, owners = self.smoothing.rows[0] != 0, []
        free = np.ones(len(left), dtype=bool)
        for own in self.local:
            outside = np.ones(self.smoothing.dimension, dtype=bool)
            outside[own] = False
            here = free & ~np.any(left[:, outside], axis=1)
            owners.append(np.flatnonzero(here))
            free &= ~here
        return owners

    def _stretch(self, n: int) -> tuple[float, float]:
        """Factors of n rows of data, whose mean square is theirs over `count` samples, and of the bends beside them."""
        total = n + len(self.smoothing.rows[0])
        return float(np.sqrt(total / n)), float(np.sqrt(total / self.count))
