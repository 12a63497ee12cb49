"""Smooth trajectories that rest before, between and after their moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.polynomial import Polynomial

from plantfit.errors import SimulationError


@dataclass(frozen=True)
class Move:
    """From where the trajectory rests to the value `to`, from `start` over `duration` (s)."""

    start: float
    duration: float
    to: float

    @property
    def end(self) -> float:
        return self.start + self.duration


@dataclass(frozen=True)
class RestToRest:
    """Value `rest` until the first move, and rest between the moves, which come in order of time.

    Each move is the polynomial of lowest degree, 2 r + 1, whose first r = `smoothness` derivatives are zero at both
    ends: s(x) = x^(r+1) sum_k C(r+k, k) (1-x)^k, x from 0 to 1. A flat output of relative degree d needs r >= d for an
    input without jumps. Raises SimulationError for moves that overlap, last no time or are not finite.
    """

    rest: float
    moves: tuple[Move, ...]
    smoothness: int = 5

    def __post_init__(self) -> None:
        if isinstance(self.smoothness, bool) or not isinstance(self.smoothness, int) or not 0 <= self.smoothness <= 20:
            raise SimulationError(f"smoothness = {self.smoothness!r}; give a whole number of derivatives from 0 to 20.")
        before = -np.inf
        for move in self.moves:
            if not (np.all(np.isfinite([move.start, move.duration, move.to])) and move.duration > 0):
                raise SimulationError(
                    f"A move at {move.start} s over {move.duration} s "
                    f"to {move.to}; give finite numbers, a duration > 0."
                )
            if move.start < before:
                raise SimulationError(
                    f"A move starts at {move.start:g} s, before the one before it ends at {before:g} s; start it later."
                )
            before = move.end

    def __call__(self, t: Sequence[float] | np.ndarray, derivative: int = 0) -> np.ndarray:
        """The derivative of that order (0: the value itself) at times t (n,) in seconds."""
        t = np.asarray(t, dtype=float)
        shape = _step(self.smoothness).deriv(derivative) if derivative else _step(self.smoothness)
        result, at = np.full(t.shape, self.rest if derivative == 0 else 0.0), self.rest
        for move in self.moves:
            inside = (t > move.start) & (t < move.end)
            result[inside] = (
                (move.to - at) * shape((t[inside] - move.start) / move.duration) / move.duration**derivative
            )
            if derivative == 0:
                result[inside] += at
                result[t >= move.end] = move.to
            at = move.to
        return result


def _step(r: int) -> Polynomial:
    """From 0 at x = 0 to 1 at x = 1 with r derivatives that are zero at both."""
    x, y = Polynomial([0.0, 1.0]), Polynomial([1.0, -1.0])
    rest = Polynomial([0.0])
    for k in range(r + 1):
        rest = rest + comb(r + k, k) * y**k
    return x ** (r + 1) * rest
