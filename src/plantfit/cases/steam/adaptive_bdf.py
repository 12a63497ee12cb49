"""The chamber by scipy's adaptive BDF, as the paper simulated it, and what finite differences through it are worth.

Plain floats and no jax, so that a process of its own starts at once.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from plantfit.cases.steam.bdf_course import Course

OWN = 31  # coordinates of an opening: k[10], A1[10], A2[10], Td
EPS = 1e-8  # scipy's step of a forward difference, for numbers between 0 and 1


@dataclass(frozen=True)
class Step:
    """The record of one opening: `opening` (%), times `t` (n,) in s, pressures `y` (n,) in bar, both without the
    sample at t = 0."""

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
        return self._course(row, step).pressures

    def around(self, row: np.ndarray, step: Step) -> tuple[float, Callable[[np.ndarray], float]]:
        """Mean squared error, bar^2, and the same of other rows as a function; a large number where the solver gave up.

        The function is quick for rows that differ in a few numbers, and has the bits of a solution from the beginning.
        """
        course = self._course(row, step)
        return _mean_square(course.pressures, step), lambda other: _mean_square(course.moved(other), step)

    def _course(self, row: np.ndarray, step: Step) -> Course:
        return Course(row, step.opening, step.t, self.rtol, self.atol, self.at_the_edge)


def _mean_square(pressures: np.ndarray, step: Step) -> float:
    error = float(np.mean((pressures - step.y) ** 2))
    return error if np.isfinite(error) else 1e6


@dataclass
class Cost:
    """Equation (7) over some openings at a cube point (31 for each); every whole cost counts as one evaluation.

    A coordinate moves the response of its own opening only: a finite difference simulates that one, from where the
    coordinate begins to matter, and adds the others' costs as they were, which gives the same number as simulating all.
    """

    steps: Sequence[Step]
    lower: np.ndarray  # (31,)
    upper: np.ndarray  # (31,)
    solver: Solver
    budget: int
    # differences (d,) that are known, by the bytes of their point
    slopes: Mapping[bytes, np.ndarray] = field(default_factory=dict)
    evaluations: int = 0

    def __post_init__(self) -> None:
        self.history: list[tuple[int, float]] = []
        self.best = (np.inf, np.zeros(0))
        self._known: tuple[bytes, np.ndarray, list[Callable[[np.ndarray], float]]] = (b"", np.zeros(0), [])

    def parts(self, z: np.ndarray) -> np.ndarray:
        """Mean squared error (openings,) of each opening."""
        key = z.tobytes()
        if key != self._known[0]:
            self._charge(1)
            costs, others = zip(
                *(self.solver.around(self._row(z, i), step) for i, step in enumerate(self.steps)), strict=True
            )
            found = np.array(costs)
            self._known = (key, found, list(others))
            self._remember(z, float(np.sum(found)))
        return self._known[1]

    def __call__(self, z: np.ndarray) -> float:
        return float(np.sum(self.parts(z)))

    def differences(self, z: np.ndarray) -> np.ndarray:
        """Forward differences (d,) with the step 1e-8, backward ones at the upper bound, as scipy takes them."""
        parts, value, slope = self.parts(z), self(z), np.zeros(len(z))
        self._charge(len(z))
        if z.tobytes() in self.slopes:
            return self.slopes[z.tobytes()].copy()
        others = self._known[2]
        for j in range(len(z)):
            i, moved = j // OWN, z.copy()
            moved[j] += EPS if z[j] + EPS <= 1.0 else -EPS
            changed = parts.copy()
            changed[i] = others[i](self._row(moved, i))
            slope[j] = (float(np.sum(changed)) - value) / (moved[j] - z[j])
        return slope

    def _row(self, z: np.ndarray, i: int) -> np.ndarray:
        return self.lower + (self.upper - self.lower) * z[OWN * i : OWN * (i + 1)]

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
    """Where L-BFGS-B ended: cube point (d,), cost, evaluations, why, and the evaluations and best cost (k,) on its
    way."""

    x: np.ndarray
    cost: float
    evaluations: int
    why: str
    history_evaluations: np.ndarray
    history_cost: np.ndarray


def descend(cost: Cost, start: np.ndarray) -> Descent:
    """scipy's L-BFGS-B with its own settings, its gradient by finite differences."""
    try:
        why = str(
            minimize(cost, start, jac=cost.differences, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start)).message
        )
    except _Spent:
        why = "budget spent"
    at, costs = np.array(cost.history, dtype=float).T
    return Descent(
        cost.best[1],
        cost.best[0],
        cost.evaluations,
        why,
        np.append(at, cost.evaluations),
        np.append(costs, cost.best[0]),
    )


@dataclass(frozen=True)
class Descents:
    """Finite differences (d,) at the start; L-BFGS-B on all openings at once, and on each alone where asked for."""

    slopes: np.ndarray
    together: Descent
    alone: tuple[Descent, ...]
    seconds: float


def descents(
    steps: Sequence[Step], lower: np.ndarray, upper: np.ndarray, start: np.ndarray, together: int, alone: int
) -> Descents:
    """From `start` (31 a step) with `together` evaluations for all at once, and `alone` for each opening by itself
    (0: not so)."""
    began, solver = time.process_time(), Solver()
    slopes = Cost(steps, lower, upper, solver, 1 + len(start)).differences(start)
    whole = descend(Cost(steps, lower, upper, solver, together, {start.tobytes(): slopes}), start)
    each = [
        descend(Cost([s], lower, upper, solver, alone), start[OWN * i : OWN * (i + 1)])
        for i, s in enumerate(steps)
        if alone
    ]
    return Descents(slopes, whole, tuple(each), time.process_time() - began)
