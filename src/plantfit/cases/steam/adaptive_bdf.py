"""The chamber by scipy's adaptive BDF, as the paper simulated it, and what finite differences through it are worth.

Plain floats and no jax, so that a process of its own starts at once.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

TOP, SEGMENTS = 20.0, 9  # bar; equal pieces of the tables on [0, TOP]
OWN = 31  # coordinates of an opening: k[10], A1[10], A2[10], Td
EPS = 1e-8  # scipy's step of a forward difference, for numbers between 0 and 1


@dataclass(frozen=True)
class Step:
    """The record of one opening: `opening` (%), times `t` (n,) in s, pressures `y` (n,) in bar, both without the sample at t = 0."""

    opening: float
    t: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Solver:
    """Tolerances of `solve_ivp`; scipy's own by default. `at_the_edge` begins at the delayed step in place of t = 0."""

    rtol: float = 1e-3
    atol: float = 1e-6
    at_the_edge: bool = False

    def pressures(self, row: np.ndarray, step: Step) -> np.ndarray:
        """Pressures (n,) in bar; `row` (31,) holds k[10], A1[10], A2[10], Td."""
        begin, on = (float(row[-1]), step.t > row[-1]) if self.at_the_edge else (0.0, np.ones(len(step.t), bool))
        y = np.zeros(len(step.t))
        found = solve_ivp(
            rate(row, step.opening), (begin, step.t[-1]), [0.0, 0.0], "BDF", t_eval=step.t[on], rtol=self.rtol, atol=self.atol
        )
        y[on] = found.y[0] if found.success else np.nan
        return y

    def cost(self, row: np.ndarray, step: Step) -> float:
        """Mean squared error, bar^2; a large number where the solver gave up."""
        error = float(np.mean((self.pressures(row, step) - step.y) ** 2))
        return error if np.isfinite(error) else 1e6


def rate(row: np.ndarray, opening: float) -> Callable[[float, Sequence[float]], list[float]]:
    """d(x1, x2)/dt of equation (2), the valve opening Td s after t = 0."""
    k, a1, a2 = (_pieces(table) for table in np.split(row[:30], 3))
    delay = float(row[30])

    def derivative(t: float, x: Sequence[float]) -> list[float]:
        x1, x2 = float(x[0]), float(x[1])
        y = min(max(x1, 0.0), TOP)
        j = min(int(y * (SEGMENTS / TOP)), SEGMENTS - 1)
        u = opening if t >= delay else 0.0
        return [x2, ((k[j][0] + k[j][1] * y) * u - x1 - (a1[j][0] + a1[j][1] * y) * x2) / (a2[j][0] + a2[j][1] * y)]

    return derivative


def _pieces(table: np.ndarray) -> list[tuple[float, float]]:
    """(value at 0, slope) of each straight piece."""
    slope = np.diff(table) * (SEGMENTS / TOP)
    return list(zip((table[:-1] - slope * (TOP / SEGMENTS) * np.arange(SEGMENTS)).tolist(), slope.tolist(), strict=True))


@dataclass
class Cost:
    """Equation (7) over some openings at a cube point (31 for each); every whole cost counts as one evaluation.

    A coordinate moves the response of its own opening only: a finite difference simulates that one, and adds the others'
    costs as they were, which gives the same number as simulating all.
    """

    steps: Sequence[Step]
    lower: np.ndarray  # (31,)
    upper: np.ndarray  # (31,)
    solver: Solver
    budget: int
    evaluations: int = 0

    def __post_init__(self) -> None:
        self.history: list[tuple[int, float]] = []
        self.best = (np.inf, np.zeros(0))
        self._known: tuple[bytes, np.ndarray] = (b"", np.zeros(0))

    def parts(self, z: np.ndarray) -> np.ndarray:
        """Mean squared error (openings,) of each opening."""
        key = z.tobytes()
        if key != self._known[0]:
            self._charge(1)
            found = np.array([self._one(i, z[OWN * i : OWN * (i + 1)]) for i in range(len(self.steps))])
            self._known = (key, found)
            self._remember(z, float(np.sum(found)))
        return self._known[1]

    def __call__(self, z: np.ndarray) -> float:
        return float(np.sum(self.parts(z)))

    def differences(self, z: np.ndarray) -> np.ndarray:
        """Forward differences (d,) with the step 1e-8, backward ones at the upper bound, as scipy takes them."""
        parts, value, slope = self.parts(z), self(z), np.zeros(len(z))
        self._charge(len(z))
        for j in range(len(z)):
            i, moved = j // OWN, z.copy()
            moved[j] += EPS if z[j] + EPS <= 1.0 else -EPS
            changed = parts.copy()
            changed[i] = self._one(i, moved[OWN * i : OWN * (i + 1)])
            slope[j] = (float(np.sum(changed)) - value) / (moved[j] - z[j])
        return slope

    def _one(self, i: int, z: np.ndarray) -> float:
        return self.solver.cost(self.lower + (self.upper - self.lower) * z, self.steps[i])

    def _charge(self, count: int) -> None:
        if self.evaluations + count > self.budget:
            raise _Spent
        self.evaluations += count

    def _remember(self, z: np.ndarray, cost: float) -> None:
        if cost < self.best[0]:
            self.best = (cost, z.copy())
            self.history.append((self.evaluations, cost))


class _Spent(Exception):
    """The next gradient or cost would pass the budget."""


@dataclass(frozen=True)
class Descent:
    """Where L-BFGS-B ended: cube point (d,), cost, evaluations, why, and the evaluations and best cost (k,) on its way."""

    x: np.ndarray
    cost: float
    evaluations: int
    why: str
    history_evaluations: np.ndarray
    history_cost: np.ndarray


def descend(cost: Cost, start: np.ndarray) -> Descent:
    """scipy's L-BFGS-B with its own settings, its gradient by finite differences."""
    try:
        why = str(minimize(cost, start, jac=cost.differences, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start)).message)
    except _Spent:
        why = "budget spent"
    at, costs = np.array(cost.history, dtype=float).T
    return Descent(cost.best[1], cost.best[0], cost.evaluations, why, np.append(at, cost.evaluations), np.append(costs, cost.best[0]))


@dataclass(frozen=True)
class Descents:
    """Finite differences (d,) at the start; L-BFGS-B on all openings at once, and on each alone where asked for."""

    slopes: np.ndarray
    together: Descent
    alone: tuple[Descent, ...]
    seconds: float


def descents(steps: Sequence[Step], lower: np.ndarray, upper: np.ndarray, start: np.ndarray, together: int, alone: int) -> Descents:
    """From `start` (31 a step) with `together` evaluations for all at once, and `alone` for each opening by itself (0: not so)."""
    began, solver = time.process_time(), Solver()
    slopes = Cost(steps, lower, upper, solver, 1 + len(start)).differences(start)
    whole = descend(Cost(steps, lower, upper, solver, together), start)
    each = [descend(Cost([s], lower, upper, solver, alone), start[OWN * i : OWN * (i + 1)]) for i, s in enumerate(steps) if alone]
    return Descents(slopes, whole, tuple(each), time.process_time() - began)
