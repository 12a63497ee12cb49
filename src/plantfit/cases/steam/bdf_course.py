"""One solution by scipy's BDF, kept step by step, and the solutions of other numbers that leave it where these begin to
matter.

A finite difference moves one number of 31, which the solver first reads when the pressure comes near its node. Until
then every step is the same to the last bit, and where the number is never read, the whole solution is. `Course.moved`
takes up the solver as it stood before the first step that reads another number; its bits are those of a solution from
the beginning.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.integrate import BDF
from scipy.linalg.lapack import dgetrf, dgetrs

TOP, SEGMENTS = 20.0, 9  # bar; equal pieces of the tables on [0, TOP]


class Rate:
    """d(x1, x2)/dt of equation (2), the valve opening Td s after t = 0; notes which pieces of the tables it read, and
    when it was called.

    `row` (31,) holds k[10], A1[10], A2[10], Td.
    """

    def __init__(self, row: np.ndarray, opening: float):
        self.k, self.a1, self.a2 = (_pieces(table) for table in np.split(row[:30], 3))
        self.delay, self.opening = float(row[30]), opening
        self.read, self.times = 0, list[float]()  # a bit for each piece

    def __call__(self, t: float, x: Sequence[float]) -> list[float]:
        x1, x2 = float(x[0]), float(x[1])
        y = min(max(x1, 0.0), TOP)
        j = min(int(y * (SEGMENTS / TOP)), SEGMENTS - 1)
        self.read |= 1 << j
        self.times.append(t)
        u = self.opening if t >= self.delay else 0.0
        (k, k_slope), (a1, a1_slope), (a2, a2_slope) = self.k[j], self.a1[j], self.a2[j]
        return [x2, ((k + k_slope * y) * u - x1 - (a1 + a1_slope * y) * x2) / (a2 + a2_slope * y)]

    def take(self, other: "Rate") -> None:
        """Go on with the numbers of another one."""
        self.k, self.a1, self.a2, self.delay = other.k, other.a1, other.a2, other.delay

    def noted(self) -> tuple[int, list[float]]:
        """The pieces that were read, and the times of the calls, since it was asked last."""
        found = self.read, self.times
        self.read, self.times = 0, []
        return found


def _pieces(table: np.ndarray) -> list[tuple[float, float]]:
    """(value at 0, slope) of each straight piece."""
    slope = np.diff(table) * (SEGMENTS / TOP)
    return list(
        zip((table[:-1] - slope * (TOP / SEGMENTS) * np.arange(SEGMENTS)).tolist(), slope.tolist(), strict=True)
    )


class Course:
    """Pressures (n,) in bar at `t` (n,) in s of the chamber with the numbers `row` (31,), from rest; NaN where the
    solver gave up.

    `at_the_edge` begins at the delayed step in place of t = 0; pressures before are 0.
    """

    def __init__(
        self, row: np.ndarray, opening: float, t: np.ndarray, rtol: float, atol: float, at_the_edge: bool = False
    ):
        self._arguments = opening, t, rtol, atol, at_the_edge
        self._own = Rate(row, opening)
        self._rate = Rate(row, opening)  # takes other numbers for other solutions
        self._solver, done = _begun(self._rate, *self._arguments)
        # of each step; first of the making
        self._noted, self._before, self._done = ([self._rate.noted()], [dict[str, Any]()], [done])
        self.pressures = np.zeros(len(t))
        while self._solver.status == "running":
            self._before.append(_copied(vars(self._solver)))
            self._done.append(done)
            done = _step(self._solver, t, self.pressures, done)
            self._noted.append(self._rate.noted())

    def moved(self, row: np.ndarray) -> np.ndarray:
        """The pressures of other numbers, with the bits of `Course(row, ...).pressures`."""
        opening, t, *_, at_the_edge = self._arguments
        other = Rate(row, opening)
        first = 0 if at_the_edge and other.delay != self._own.delay else self._first_that_reads(other)
        if first is None:
            return self.pressures
        if first == 0:  # as early as the solver was made
            solver, done = _begun(other, *self._arguments)
            found = np.zeros(len(t))
        else:
            vars(self._solver).update(_copied(self._before[first]))
            self._rate.take(other)
            solver, found, done = self._solver, self.pressures.copy(), self._done[first]
        while solver.status == "running":
            done = _step(solver, t, found, done)
        return found

    def _first_that_reads(self, other: Rate) -> int | None:
        """The first entry whose calls of the rate differ for other numbers; 0 is the making of the solver."""
        own, pieces = self._own, 0
        for j in range(SEGMENTS):
            pieces |= ((own.k[j], own.a1[j], own.a2[j]) != (other.k[j], other.a1[j], other.a2[j])) << j
        low, high = sorted((own.delay, other.delay))  # the valve is open for one of both
        for i, (read, times) in enumerate(self._noted):
            if read & pieces or (low < high and any(low <= t < high for t in times)):
                return i
        return None


def _begun(rate: Rate, opening: float, t: np.ndarray, rtol: float, atol: float, at_the_edge: bool) -> tuple[BDF, int]:
    """A solver before its first step, and the samples done then."""
    begin = rate.delay if at_the_edge else 0.0
    made = _solver(rate, begin, float(t[-1]), rtol, atol)
    return made, int(np.searchsorted(t, begin, side="right")) if at_the_edge else 0


def _solver(rate: Rate, begin: float, end: float, rtol: float, atol: float) -> BDF:
    """scipy's BDF with LAPACK called directly: two unknowns are solved for in less time than scipy's checks take."""
    made = BDF(rate, begin, [0.0, 0.0], end, rtol=rtol, atol=atol)
    vars(made).update(lu=lambda a: dgetrf(a)[:2], solve_lu=lambda lu, b: dgetrs(*lu, b)[0])
    return made


def _step(solver: BDF, t: np.ndarray, y: np.ndarray, done: int) -> int:
    """A step as `solve_ivp` takes it, its pressures at `t` (n,) written to `y` (n,) from the sample `done` on; the
    samples done then."""
    solver.step()
    if solver.status == "failed":
        y[:] = np.nan
        return done
    now = int(np.searchsorted(t, solver.t, side="right"))
    if now > done:
        y[done:now] = solver.dense_output()(t[done:now])[0]
    return now


def _copied(state: dict[str, Any]) -> dict[str, Any]:
    """A solver's attributes; it changes its arrays in place."""
    return {n: v.copy() if isinstance(v, np.ndarray) else v for n, v in state.items()}
