"""scipy's BDF for two unknowns, its steps on plain floats: arrays of two cost far more than their numbers.

It begins as scipy's own, takes the same decisions, and has the same bits (`scipy.integrate.BDF`, whose names are kept
here). What sums products stays with BLAS and LAPACK, which round some of them together, as floats cannot.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import BDF
from scipy.linalg.lapack import dgetrf, dgetrs

MAX_ORDER, NEWTON_MAXITER = 5, 4
MIN_FACTOR, MAX_FACTOR = 0.2, 10.0
ROOT = 2**0.5  # of the number of unknowns

Pair = tuple[float, float]
Factors = tuple[np.ndarray, np.ndarray]  # L and U in one, and the rows that changed places


class State(NamedTuple):
    """All that a solver takes on from step to step; `differences` (16,) are its backward differences."""

    t: float
    h_abs: float
    order: int
    n_equal_steps: int
    jacobian: np.ndarray
    factors: Factors | None
    jac_factor: np.ndarray
    differences: np.ndarray
    running: bool


class BdfOfTwo:
    """From (0, 0) at `begin` to `end` > `begin`, both in s; `rate(t, x)` gives d(x1, x2)/dt."""

    def __init__(self, rate: Callable[[float, Pair], list[float]], begin: float, end: float, rtol: float, atol: float):
        self._rate, self._end, self._rtol, self._atol = rate, end, rtol, atol
        self._scipy = made = BDF(rate, begin, [0.0, 0.0], end, rtol=rtol, atol=atol)
        self.t, self.running = float(begin), True
        self._h_abs, self._order, self._n_equal_steps = float(made.h_abs), 1, 0
        self._jacobian = np.asarray(made.J)
        self._factors: Factors | None = None
        self._tolerance = float(made.newton_tol)
        self._alpha, self._error_const = made.alpha.tolist(), made.error_const.tolist()
        self._differences = made.D  # (8, 2)
        self._numbers = _numbers(self._differences)
        self._late = [(self._differences[1 : k + 1].T, made.gamma[1 : k + 1]) for k in range(MAX_ORDER + 1)]
        self._psi, self._of_psi = _two()
        self._ratio, self._of_ratio = _two()
        self._solved, self._of_solved = _two()

    def state(self) -> State:
        """Where it stands."""
        return State(
            self.t, self._h_abs, self._order, self._n_equal_steps, self._jacobian, self._factors,
            self._scipy.jac_factor, self._differences.copy(), self.running,
        )  # fmt: skip

    def go_back(self, to: State) -> None:
        """Stand where it stood before."""
        self.t, self._h_abs, self._order, self._n_equal_steps, self._jacobian, self._factors = to[:6]
        self._scipy.jac_factor, self.running = to.jac_factor, to.running
        self._differences[:] = to.differences

    def step(self) -> bool:
        """A step; False where the solver gives up. `running` until `end` is reached."""
        t, numbers, order, h_abs = self.t, self._numbers, self._order, self._h_abs
        min_step = 10.0 * abs(math.nextafter(t, math.inf) - t)
        if h_abs < min_step:
            self._rescale(order, min_step / h_abs)
            h_abs = min_step
        rtol, atol, alpha, error_const = self._rtol, self._atol, self._alpha[order], self._error_const
        jacobian, factors, current = self._jacobian, self._factors, False
        while True:
            if h_abs < min_step:
                self.running = False
                return False
            t_new = t + h_abs
            if t_new > self._end:
                t_new = self._end
                self._rescale(order, abs(t_new - t) / h_abs)
                factors = None
            h_abs = abs(t_new - t)
            c = (t_new - t) / alpha
            x1, x2 = numbers[0], numbers[1]
            for k in range(2, 2 * order + 2, 2):
                x1, x2 = x1 + numbers[k], x2 + numbers[k + 1]
            np.dot(*self._late[order], self._psi)
            psi1, psi2 = self._of_psi[0] / alpha, self._of_psi[1] / alpha
            while True:
                if factors is None:
                    factors = dgetrf(self._scipy.I - c * jacobian)[:2]
                found = self._newton(t_new, x1, x2, c, psi1, psi2, factors)
                if found is not None or current:
                    break
                jacobian, factors, current = np.asarray(self._scipy.jac(t_new, np.array([x1, x2]))), None, True
            if found is None:
                h_abs *= 0.5
                self._rescale(order, 0.5)
                factors = None
                continue
            iterations, y1, y2, d1, d2 = found
            safety = 0.9 * (2 * NEWTON_MAXITER + 1) / (2 * NEWTON_MAXITER + iterations)
            scale1, scale2 = atol + rtol * abs(y1), atol + rtol * abs(y2)
            error_norm = self._norm(error_const[order] * d1 / scale1, error_const[order] * d2 / scale2)
            if not error_norm > 1.0:
                break
            factor = max(MIN_FACTOR, safety * error_norm ** (-1 / (order + 1)))
            h_abs *= factor
            self._rescale(order, factor)
        self._n_equal_steps += 1
        self.t, self._h_abs, self._jacobian, self._factors = t_new, h_abs, jacobian, factors
        self.running = t_new < self._end
        k = 2 * order + 2
        numbers[k + 2], numbers[k + 3] = d1 - numbers[k], d2 - numbers[k + 1]
        numbers[k], numbers[k + 1] = d1, d2
        for k in range(2 * order, -1, -2):
            d1, d2 = numbers[k] + d1, numbers[k + 1] + d2
            numbers[k], numbers[k + 1] = d1, d2
        if self._n_equal_steps > order:
            self._choose_order(error_norm, safety, scale1, scale2)
        return True

    def first_between(self, t: np.ndarray) -> np.ndarray:
        """The first unknown (n,) at times `t` (n,) of the last step."""
        order, h = self._order, self._h_abs
        behind = _numbered(order)
        x = (t - (self.t - h * behind)) / (h * (1 + behind))
        return np.dot(self._late[order][0], np.multiply.accumulate(x, 0))[0] + self._numbers[0]

    def _newton(
        self, t: float, x1: float, x2: float, c: float, psi1: float, psi2: float, factors: Factors
    ) -> tuple[int, float, float, float, float] | None:
        """Iterations, unknowns at `t`, and what they differ by from those predicted; None where it does not
        converge."""
        scale1, scale2 = self._atol + self._rtol * abs(x1), self._atol + self._rtol * abs(x2)
        rate, solved, of_solved, tolerance = self._rate, self._solved, self._of_solved, self._tolerance
        d1 = d2 = last = 0.0
        for k in range(NEWTON_MAXITER):
            f1, f2 = rate(t, (x1, x2))
            if not (math.isfinite(f1) and math.isfinite(f2)):
                return None
            of_solved[0], of_solved[1] = c * f1 - psi1 - d1, c * f2 - psi2 - d2
            dgetrs(*factors, solved, overwrite_b=1)
            dx1, dx2 = of_solved[0], of_solved[1]
            norm, ratio = self._norm(dx1 / scale1, dx2 / scale2), None
            if k:
                ratio = norm / last
                if ratio >= 1 or ratio ** (NEWTON_MAXITER - k) / (1 - ratio) * norm > tolerance:
                    return None
            x1, x2, d1, d2 = x1 + dx1, x2 + dx2, d1 + dx1, d2 + dx2
            if norm == 0 or (ratio is not None and ratio / (1 - ratio) * norm < tolerance):
                return k + 1, x1, x2, d1, d2
            last = norm
        return None

    def _choose_order(self, error_norm: float, safety: float, scale1: float, scale2: float) -> None:
        """The order and step of what follows, by the errors of one order less and one more."""
        order, numbers, less, more = self._order, self._numbers, math.inf, math.inf
        if order > 1:
            e = self._error_const[order - 1]
            less = self._norm(e * numbers[2 * order] / scale1, e * numbers[2 * order + 1] / scale2)
        if order < MAX_ORDER:
            e = self._error_const[order + 1]
            more = self._norm(e * numbers[2 * order + 4] / scale1, e * numbers[2 * order + 5] / scale2)
        with np.errstate(divide="ignore"):
            factors = (np.array([less, error_norm, more]) ** (-1 / np.arange(order, order + 3))).tolist()
        most = max(factors)
        self._order = order = order + factors.index(most) - 1
        factor = min(MAX_FACTOR, safety * most)
        self._h_abs *= factor
        self._rescale(order, factor)
        self._factors = None

    def _norm(self, a: float, b: float) -> float:
        """The root of the mean square."""
        self._of_ratio[0], self._of_ratio[1] = a, b
        return math.sqrt(self._ratio.dot(self._ratio)) / ROOT

    def _rescale(self, order: int, factor: float) -> None:
        """Backward differences for steps `factor` times as long."""
        less, counted, rows, same = _rescaling(order)
        powers = np.zeros((order + 1, order + 1))
        powers[0] = 1.0
        powers[1:, 1:] = (less - factor * counted) / rows
        both = np.multiply.accumulate(powers, 0).dot(same)
        self._differences[: order + 1] = np.dot(both.T, self._differences[: order + 1])
        self._n_equal_steps = 0


def _two() -> tuple[np.ndarray, Any]:
    """An array (2,) and its numbers."""
    made = np.zeros(2)
    return made, _numbers(made)


def _numbers(array: Any) -> Any:
    """The numbers of an array (a memoryview): one by one they are read and written in a quarter of the time."""
    return memoryview(array.reshape(-1))


@cache
def _numbered(order: int) -> np.ndarray:
    """0 to `order` - 1 as a column."""
    return np.arange(order)[:, None]


@cache
def _rescaling(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What a change of steps is made of: row numbers less one, columns, rows, and the matrix of equal steps."""
    rows, counted = np.arange(1, order + 1)[:, None], np.arange(1, order + 1)
    powers = np.zeros((order + 1, order + 1))
    powers[0] = 1.0
    powers[1:, 1:] = (rows - 1 - counted) / rows
    return rows - 1, counted, rows, np.multiply.accumulate(powers, 0)
