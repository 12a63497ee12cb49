"""Coordinates as shares of their box in physical values, in which residuals can be linear also where the cube is
searched by decades."""

from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.space import Space


@dataclass(frozen=True, eq=False)
class BoxShares:
    """Some coordinates of a space: value = lower + share (upper - lower), share from 0 to 1; all arrays (p,)."""

    lower: np.ndarray
    upper: np.ndarray
    log: np.ndarray

    @classmethod
    def of(cls, space: Space, places: np.ndarray) -> "BoxShares":
        """Those of the coordinates at these places (p,)."""
        return cls(space.lower[places], space.upper[places], space.log[places])

    @property
    def _ratio(self) -> tuple[np.ndarray, np.ndarray]:
        """Width over lower bound and logarithm of upper over lower; 1 where the scale is linear."""
        low = np.where(self.log, self.lower, 1.0)
        ratio = np.where(self.log, (self.upper - self.lower) / low, 1.0)
        return ratio, np.where(self.log, np.log1p(ratio), 1.0)

    @property
    def nearest_zero(self) -> np.ndarray:
        """Shares of the values of the box that are nearest to 0."""
        return np.clip(-self.lower / (self.upper - self.lower), 0.0, 1.0)

    def of_cube(self, z: np.ndarray) -> np.ndarray:
        """Cube coordinates (..., p) to shares."""
        ratio, decades = self._ratio
        return np.where(self.log, np.expm1(z * decades) / ratio, z)

    def cube(self, share: np.ndarray) -> np.ndarray:
        """The inverse, within the cube."""
        ratio, decades = self._ratio
        return np.clip(np.where(self.log, np.log1p(share * ratio) / decades, share), 0.0, 1.0)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """d share/d cube coordinate (..., p)."""
        ratio, decades = self._ratio
        return np.where(self.log, decades * np.exp(z * decades) / ratio, 1.0)
