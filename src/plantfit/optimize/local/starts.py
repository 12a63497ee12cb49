"""Where local searches begin: seeded points, spread points, points far from each other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Objective
from plantfit.sobol import Sobol

import jax
from jax import Array


def generator(key: Array) -> np.random.Generator:
    """A numpy generator that depends on the jax key alone."""
    return np.random.default_rng(np.asarray(jax.random.key_data(key), dtype=np.uint32))


def warm_then_uniform(start: np.ndarray | None, dimension: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """The warm starts, then uniform points without end."""
    if start is not None:
        yield from np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    while True:
        yield rng.random(dimension)


def sobol(n: int, dimension: int, rng: np.random.Generator) -> np.ndarray:
    """n points (n, d) of a scrambled Sobol sequence (Owen 1998)."""
    return Sobol(dimension, rng).random(n)


WIDE = 100.0  # ratio of the bounds of one sign from which on a coordinate spans scales
DECADES = 6.0  # below the largest magnitude, that starts are spread over
CHUNK = 3  # a third of the points is even in units, a third in decades, in a third each coordinate draws which
APART = (0.25, 0.125, 0.0625)  # of the mean random distance


@dataclass(frozen=True)
class Spread:
    """How starts are spread over a box: by units and, where a coordinate spans zero or several decades, by magnitude
    and sign.

    A box of +-1000 around a value of 0.2 holds no uniform point of the right size. `lower`, `upper` (d,) are the bounds
    in units, `wide` (d,) the coordinates that are spread by magnitude as well.
    """

    lower: np.ndarray
    upper: np.ndarray
    wide: np.ndarray

    @classmethod
    def of(cls, objective: Objective) -> "Spread":
        """By the bounds in units; everything even where the objective has none."""
        none = np.zeros(objective.dimension, dtype=bool)
        if objective.lower is None or objective.upper is None or objective.log is None:
            return cls(np.zeros(len(none)), np.ones(len(none)), none)
        low, high = np.asarray(objective.lower, dtype=float), np.asarray(objective.upper, dtype=float)
        near, far = np.minimum(abs(low), abs(high)), np.maximum(abs(low), abs(high))
        wide = ((low < 0) & (high > 0)) | (far >= WIDE * near)
        return cls(low, high, wide & ~np.asarray(objective.log, dtype=bool))

    @property
    def _smallest(self) -> np.ndarray:
        """Magnitude (d,) below which starts are not spread."""
        near, far = np.minimum(abs(self.lower), abs(self.upper)), np.maximum(abs(self.lower), abs(self.upper))
        least = far / 10**DECADES
        return np.where(self.lower * self.upper > 0, np.maximum(near, least), least)

    def points(self, u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Cube points (n, d) from even ones u (n, d)."""
        if not np.any(self.wide):
            return u
        kind = np.arange(len(u)) % CHUNK
        by_magnitude = (kind == 1)[:, None] | ((kind == 2)[:, None] & (rng.random(u.shape) < 0.5))
        return np.where(by_magnitude & self.wide, self._by_magnitude(u), u)

    def _by_magnitude(self, u: np.ndarray) -> np.ndarray:
        """Cube points whose coordinates are even in the logarithm of their magnitude, half of each sign where both
        are possible."""
        both = (self.lower < 0) & (self.upper > 0)
        negative = np.where(both, u < 0.5, self.upper <= 0)
        t = np.where(both, np.abs(2.0 * u - 1.0), u)
        least = self._smallest
        most = np.where(negative, abs(self.lower), abs(self.upper))
        least = np.minimum(least, most)
        # coordinates that are not wide are replaced by the caller
        size = np.where(self.wide, np.maximum(least, 1e-300), 1.0)
        values = np.where(negative, -1.0, 1.0) * size * (np.maximum(most, size) / size) ** t
        return np.clip((values - self.lower) / (self.upper - self.lower), 0.0, 1.0)

    def places(self, z: np.ndarray) -> np.ndarray:
        """Cube points (n, d) moved so that distances count magnitudes where coordinates are wide; again in a cube."""
        if not np.any(self.wide) or not len(z):
            return z
        values = self.lower + z * (self.upper - self.lower)
        least = np.where(self.wide, np.maximum(self._smallest, 1e-300), 1.0)
        low, high, here = (np.arcsinh(v / least) for v in (self.lower, self.upper, values))
        return np.where(self.wide, (here - low) / np.where(self.wide, high - low, 1.0), z)


def far_apart(points: np.ndarray, costs: np.ndarray) -> Iterator[int]:
    """Indices of finite points (n, d) in the order in which searches should begin there.

    First those farther from every better one of them than a quarter of the mean random distance sqrt(d / 6), best
    first; of the others those farther than half of that from all before them, and so on: many small basins next to the
    best one do not keep searches from the rest of the box. They are worked out as they are asked for: of a large sample
    few are.
    """
    left = [int(i) for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]
    columns = np.ascontiguousarray(points.T)
    # squared distance of every point to what is chosen
    nearest, apart = (np.full(len(points), np.inf), np.empty_like(columns))
    for share in APART:
        limit, others = share**2 * points.shape[1] / 6, []
        for i in left:
            if nearest[i] > limit:
                yield i
                np.subtract(columns, points[i][:, None], out=apart)
                np.minimum(nearest, np.einsum("dn,dn->n", apart, apart), out=nearest)
            else:
                others.append(i)
        left = others
    yield from left
