"""The C twin: costs of many candidates by hand-written SIMD code on one core."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.data import Steam
from benchmarks.steam.compiler import build

Scheme = Literal["exponential", "ros2"]
_CODE = {"exponential": 0, "ros2": 1}
_ROW = 16  # doubles in one row of measured values in C


@dataclass(frozen=True)
class Twin:
    """Costs and responses by twin.c; make one with `twin(...)`."""

    library: ctypes.CDLL
    steam: Steam
    measured: np.ndarray  # (4500, 16)
    scheme: Scheme = "exponential"
    substeps: int = 1

    def cost_batch(self, theta: np.ndarray) -> np.ndarray:
        """Sum over the openings of the mean squared error, bar^2: (P, 310) physical values to (P,)."""
        theta = np.ascontiguousarray(theta, dtype=float).reshape(-1, 310)
        count = len(theta)
        means, costs = np.empty((10, count)), np.empty(count)
        self.library.steam_costs(
            *self._settings(), ctypes.c_int64(count), *self._arrays(theta), _pointer(means), _pointer(costs)
        )
        return costs

    def responses(self, theta: np.ndarray) -> np.ndarray:
        """Pressures (10, 4500) bar of one candidate (310,), NaN after the end of a record."""
        theta = np.ascontiguousarray(theta, dtype=float).reshape(310)
        means, block = np.empty(10), int(self.library.steam_block())
        if block < 10:
            raise ValueError(
                f"Blocks of {block} lanes cannot hold ten openings; build the twin with a width of 2 or more."
            )
        lanes = np.empty((len(self.measured), block))
        self.library.steam_responses(*self._settings(), *self._arrays(theta), _pointer(means), _pointer(lanes))
        y = lanes[:, :10].T.copy()
        y[np.isnan(self.steam.y)] = np.nan
        return y

    def _settings(self) -> tuple[ctypes.c_int64, ctypes.c_int64]:
        return ctypes.c_int64(_CODE[self.scheme]), ctypes.c_int64(self.substeps)

    def _arrays(self, theta: np.ndarray) -> tuple:
        s = self.steam
        return (
            _pointer(theta),
            _pointer(s.opening),
            _pointer(s.samples),
            _pointer(self.measured),
            ctypes.c_double(float(s.period)),
        )


def twin(
    steam: Steam,
    scheme: Scheme = "exponential",
    substeps: int = 1,
    *,
    keep: bool = True,
    width: int = 2,
    flags: tuple[str, ...] = (),
) -> Twin | None:
    """The twin for one scheme, or None without a C compiler.

    `keep` holds each lane's table piece in registers until the lane leaves it, else it is looked up at every
    evaluation. `width` vectors of 8 lanes run together. `flags` go to the compiler.
    """
    built = build(Path(__file__).with_name("twin.c"), f"-DKEEP={int(keep)}", f"-DWIDTH={width}", *flags)
    if built is None:
        return None
    library = ctypes.CDLL(str(built))
    library.steam_block.restype = ctypes.c_int64
    measured = np.zeros((int(steam.samples.max()), _ROW))
    measured[:, :10] = np.nan_to_num(steam.y.T)
    return Twin(library, steam, measured, scheme, substeps)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
