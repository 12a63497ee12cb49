"""A problem as functions of a cube point, record by record: for regressions, static models and whatever has no
chunks of steps."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.compress import mean_square
from plantfit.problem.predictor import Predictor
from plantfit.space import Space

import jax
import jax.numpy as jnp

MEMORY = 1 << 30  # bytes that one batch of candidates may take


@dataclass(frozen=True, eq=False)
class RecordByRecord:
    """Pure functions of (z, data); `data` is `Problem.data`, of all the recordings `names` or some of them."""

    predictor: Predictor
    space: Space
    outputs: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def recordings(self) -> list[tuple[str, ...]]:
        """All of them in one block."""
        return [self.names]

    @property
    def compiled_in(self) -> Any:
        """Names of recordings: all else is looked up in `data`."""
        return self.names

    def arguments(self, data: Any) -> Any:
        """`Problem.data` as it is."""
        return data

    @property
    def local_dimension(self) -> int:
        """Coordinates that the residuals of one recording are derived by."""
        return self.space.dimension

    def residuals(self, z: Any, data: Any) -> Any:
        """Scaled residuals (m,), simulated minus measured; recording by recording, output by output."""
        values = self.space.physical(z)
        parts = []
        for name in self._present(data):
            root = jnp.sqrt(self._weight(name, data))
            y = self.predictor.outputs(self.space.tree(values, name), data["drive"][name])
            for output in self.outputs:
                picked = jnp.take(y[output], data["index"][name][output])
                parts.append(root * (picked - data["measured"][name][output]) / data["scale"][output])
        return jnp.concatenate(parts)

    def _present(self, data: Any) -> list[str]:
        """Recordings in the order of the problem; a compiled function gets its mappings sorted by name."""
        return [n for n in self.names if n in data["drive"]]

    @staticmethod
    def _weight(name: str, data: Any) -> Any:
        """How often the squares of a recording count."""
        return data["weight"][name] if "weight" in data else 1.0

    def cost(self, z: Any, data: Any) -> Any:
        """Mean of the squared scaled residuals at a cube point (d,); of a regression without looking at its samples
        again."""
        if "triangles" not in data:
            return jnp.mean(self.residuals(z, data) ** 2)
        values = self.space.physical(z)
        squares, count = 0.0, 0.0
        for name in self._present(data):
            base = self.predictor.coefficients(self.space.tree(values, name))
            for output, triangle in data["triangles"][name].items():
                squares = (
                    squares
                    + self._weight(name, data) * triangle.n * mean_square(triangle, base) / data["scale"][output] ** 2
                )
                count = count + triangle.n
        return squares / count

    def short_residuals(self, z: Any, data: Any) -> Any:
        """Residuals of a regression in k + 1 rows for each output of each recording, with the mean square of all of
        them."""
        values = self.space.physical(z)
        parts, count = [], 0.0
        for name in self._present(data):
            base = self.predictor.coefficients(self.space.tree(values, name))
            for output, triangle in data["triangles"][name].items():
                rows = jnp.append(triangle.R @ base - triangle.projected, jnp.sqrt(triangle.rest))
                parts.append(rows * jnp.sqrt(self._weight(name, data)) / data["scale"][output])
                count = count + triangle.n
        short = jnp.concatenate(parts)
        return short * jnp.sqrt(len(short) / count)

    def costs(self, zs: Any, data: Any) -> Any:
        """Costs (n,) of cube points (n, d)."""
        if "triangles" in data:
            return jax.vmap(lambda z: self.cost(z, data))(zs)
        row_bytes = 8 * 8 * sum(x.size for x in jax.tree.leaves(data["drive"])) * max(1, self.predictor.rows)
        return jax.lax.map(lambda z: self.cost(z, data), zs, batch_size=max(1, min(zs.shape[0], MEMORY // row_bytes)))

    def values_and_gradients(self, zs: Any, data: Any) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""
        if "triangles" in data:
            return jax.vmap(lambda z: jax.value_and_grad(self.cost)(z, data))(zs)
        return jax.lax.map(lambda z: jax.value_and_grad(self.cost)(z, data), zs)

    def residuals_and_jacobian(self, z: Any, data: Any) -> tuple[Any, Any]:
        """Residuals (m,) and dense derivatives (m, d)."""
        return _with_jacobian(self.residuals, z, data)

    def blocks(self, z: Any, data: Any) -> list[tuple[Any, Any]]:
        """Residuals and derivatives in one block, by all coordinates; few rows of the same mean square for a
        regression."""
        return [_with_jacobian(self.short_residuals if "triangles" in data else self.residuals, z, data)]

    def only(self, arguments: Any, wanted: np.ndarray) -> Any:
        """There is one block."""
        return arguments

    @property
    def local(self) -> np.ndarray:
        """Coordinates of every block (1, d)."""
        return np.arange(self.space.dimension)[None, :]


def _with_jacobian(residuals: Any, z: Any, data: Any) -> tuple[Any, Any]:
    """Residuals (m,) and their derivatives (m, d)."""

    def once(z):
        r = residuals(z, data)
        return r, r

    jacobian, r = jax.jacfwd(once, has_aux=True)(z)
    return r, jacobian
