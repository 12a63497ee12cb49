"""Scrambled Sobol points: those of `scipy.stats.qmc.Sobol` bit for bit, without importing scipy.stats, which takes
as long as jax."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

BITS = 30  # of a coordinate
MOST_DIMENSIONS = 21201  # direction numbers of Joe and Kuo


class Sobol:
    """One Sobol sequence in `dimension` coordinates, scrambled by the generator.

    Sobol 1967, USSR Computational Mathematics and Mathematical Physics 7:86; direction numbers of Joe and Kuo 2008,
    SIAM Journal on Scientific Computing 30:2635, from scipy's file; scrambling of Matousek 1998, Journal of Complexity
    14:527.
    """

    def __init__(self, dimension: int, rng: np.random.Generator):
        if not 1 <= dimension <= MOST_DIMENSIONS:
            raise ValueError(f"Sobol points exist in 1 to {MOST_DIMENSIONS} dimensions, not in {dimension}.")
        rng = rng.spawn(1)[0]  # as scipy does
        powers = np.uint32(1) << np.arange(BITS, dtype=np.uint32)
        self._point = np.dot(rng.integers(2, size=(dimension, BITS), dtype=np.uint32), powers)
        lower = np.tril(rng.integers(2, size=(dimension, BITS, BITS), dtype=np.uint32))
        lower[:, np.arange(BITS), np.arange(BITS)] = 1
        self._directions = _scrambled(_directions(dimension), lower, powers)
        self._drawn = 0

    def random(self, n: int) -> np.ndarray:
        """The next n points (n, d) in the unit cube."""
        if self._drawn + n > 1 << BITS:
            raise ValueError(f"A sequence has {1 << BITS} points, and {self._drawn} of them are drawn; draw fewer.")
        points = np.empty((n, len(self._point)), dtype=np.uint32)
        for i in range(n):
            if self._drawn:
                before = self._drawn - 1
                lowest_zero = (~before & (before + 1)).bit_length() - 1
                self._point = self._point ^ self._directions[:, lowest_zero]
            points[i] = self._point
            self._drawn += 1
        return points * (1.0 / (1 << BITS))


def _directions(dimension: int) -> np.ndarray:
    """Direction numbers (d, bits) before scrambling."""
    poly, start = _published()
    v = np.ones((dimension, BITS), dtype=np.uint32)
    for row in range(1, dimension):
        p = int(poly[row])
        m = p.bit_length() - 1
        own = [int(k) for k in start[row, :m]]
        for j in range(m, BITS):
            new = own[j - m]
            for k in range(m):
                if p >> (m - 1 - k) & 1:
                    new ^= own[j - k - 1] << (k + 1)
            own.append(new)
        v[row] = own[:BITS]
    return v << np.arange(BITS - 1, -1, -1, dtype=np.uint32)


def _scrambled(v: np.ndarray, lower: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Direction numbers (d, bits) whose bits are multiplied by lower triangular matrices (d, bits, bits) modulo 2."""
    bits = (v[:, :, None] & powers[::-1]) != 0  # the highest one first
    product = np.einsum("dpk,djk->djp", lower, bits.astype(np.uint32)) & 1
    return (product * powers[::-1]).sum(axis=2, dtype=np.uint32)


@cache
def _published() -> tuple[np.ndarray, np.ndarray]:
    """Polynomials (d,) and first direction numbers (d, 18) of Joe and Kuo."""
    scipy = find_spec("scipy")
    assert scipy is not None
    assert scipy.origin is not None
    with np.load(Path(scipy.origin).parent / "stats" / "_sobol_direction_numbers.npz") as file:
        return file["poly"], file["vinit"]
