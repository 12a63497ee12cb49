"""What a host method searches through: it counts, keeps the best point and enforces the budget."""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Interrupted, SearchError
from plantfit.optimize.contract import CostOfData, KeptCosts, Objective, Projected
from plantfit.optimize.local.damped_steps import Rows

import jax

Group = tuple[np.ndarray, np.ndarray]  # residuals (k,) and derivatives (k, q) of a separable group

# candidates per compiled evaluation: three shapes for any number of points; 32 side by side take little longer than 16
CHUNKS = (64, 32, 16)
TOGETHER = 4  # points with derivatives in one call: of searches side by side few are under way most of the time
ALONE = 200  # points in a row that came alone, from which on those that fill up cost more than to compile without them


class BudgetSpent(Exception):
    """The next evaluation would overrun the budget; ends a host method from inside."""


class TargetReached(Exception):
    """The target cost was met; ends a host method from inside."""


def _filled(x: np.ndarray, width: int) -> np.ndarray:
    return np.concatenate([x, np.repeat(x[:1], width - len(x), axis=0)])


@lru_cache(maxsize=32)
def _compiled(costs: Callable) -> Callable:
    if isinstance(costs, KeptCosts):
        return costs.keep(costs.function, "candidates", ())
    return costs if hasattr(costs, "lower") else jax.jit(costs)  # what is compiled already is not compiled anew


def _pieces(count: int) -> Iterator[tuple[int, int]]:
    """Begin and size of the chunks that cover `count` points with little filling."""
    large, middle, small = CHUNKS
    at = 0
    while at < count:
        rest = count - at
        size = large if rest > large - small else middle if rest > small else small
        yield at, size
        at += size


class Counter:
    """Evaluations of one run of a host method.

    Every call charges its price before it evaluates and raises BudgetSpent when the rest of the budget
    does not cover it. Costs that are not finite count as failures. `rank`, when a method sets it, maps
    residuals to the number that decides which point is best (robust losses); the cost kept with the point
    stays mean(residuals**2). `extra` ends in RunResult.extra.
    """

    def __init__(
        self,
        objective: Objective,
        budget: float,
        *,
        target: float | None = None,
        stop: Callable[[], bool] | None = None,
        report: Callable[["Counter"], None] | None = None,
    ):
        self.objective, self.budget = objective, float(budget)
        self.spent = 0.0
        self.failures = 0
        self.best_x = np.full(objective.dimension, 0.5)
        self.best_cost = np.inf
        self.history: list[tuple[float, float]] = []
        self.extra: dict[str, Any] = {}
        self.rank: Callable[[np.ndarray], float] | None = None
        self.projected: Projected | None = None  # set by a method that solves for what is affine
        self._best_rank, self._alone = np.inf, 0
        self._target, self._stop, self._report = target, stop, report

    @property
    def remaining(self) -> float:
        return self.budget - self.spent

    def costs(self, x: np.ndarray) -> np.ndarray:
        """Costs (n,) of points (n, d); not-finite ones come back as +inf. Charges n."""
        x = np.atleast_2d(np.asarray(x, dtype=float))
        self._charge(len(x))
        f = np.concatenate([self._chunk(x[i : i + size], size) for i, size in _pieces(len(x))])
        before = self.spent - len(x)
        for k in range(len(x)):
            self._record(x[k], f[k], f[k], before + k + 1)
        self._after()
        return f

    def _chunk(self, x: np.ndarray, size: int) -> np.ndarray:
        costs, filled = self.objective.costs, _filled(x, size)
        found = (
            _compiled(costs.function)(filled, costs.data) if isinstance(costs, CostOfData) else _compiled(costs)(filled)
        )
        f = np.array(found, dtype=float)[: len(x)]
        return np.where(np.isfinite(f), f, np.inf)

    def value_and_gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost and gradient (d,); a failed point has cost +inf and gradient 0."""
        if self.objective.value_and_gradient is None:
            raise SearchError("The method needs a gradient, but the problem has none; choose 'cmaes' or 'pso'.")
        self._charge(self.objective.gradient_charge)
        value, gradient = self.objective.value_and_gradient(x)
        value, gradient = float(value), np.array(gradient, dtype=float)
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            value, gradient = np.inf, np.zeros(len(x))
        self._record(x, value, value, self.spent)
        self._after()
        return value, gradient

    def residuals_and_jacobian(self, x: np.ndarray, *, compressed: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) and Jacobian (m, d); a failed point has NaN residuals.

        `compressed` takes the few rows that are as good for plain least squares, where the objective has them.
        """
        whole, few = self.objective.residuals_and_jacobian, self.objective.compressed
        if whole is None:
            raise SearchError(
                "The method needs residuals, but the problem has none; choose 'lbfgsb', 'cmaes' or 'pso'."
            )
        self._charge(self.objective.jacobian_charge)
        r, jacobian = (np.array(a, dtype=float) for a in (few if compressed and few is not None else whole)(x))
        # residuals whose squares overflow cannot be compared either
        if not (np.all(np.abs(r) < 1e150) and np.all(np.isfinite(jacobian))):
            r, jacobian = np.full(r.shape, np.nan), np.zeros(jacobian.shape)
        cost = float(np.mean(r**2))
        self._record(x, cost, cost if self.rank is None else self.rank(r), self.spent)
        self._after()
        return r, jacobian

    def rows(self, x: np.ndarray, width: int) -> Rows:
        """Residuals and derivatives at n points (n, d) in rows, at most `width` points; a failed point has NaN
        residuals.

        The objective sees `TOGETHER` points every time, or `width` if that is less, filled up with the first, so that
        it is compiled once; of a long search of one point after another it sees the points as they come.
        """
        assert self.objective.batch_rows is not None
        self._charge(len(x) * self.objective.jacobian_charge)
        self._alone = self._alone + 1 if len(x) == 1 else 0
        size = 1 if self._alone > ALONE else min(width, TOGETHER)
        found = [self.objective.batch_rows(_filled(x[i : i + size], size)) for i in range(0, len(x), size)]
        r, jacobian = found[0] if len(found) == 1 else map(np.concatenate, zip(*found, strict=True))
        return self._taken(Rows(r, jacobian, x), self.objective.jacobian_charge, len(x))

    def projected_rows(self, x: np.ndarray, below: np.ndarray | None = None) -> Rows:
        """The same of the projected problem at n points (n, q) of its fewer coordinates.

        A point that costs more than its entry of `below` (n,) may come without derivatives, for less.
        """
        assert self.projected is not None
        self._charge(len(x) * self.projected.charge)
        r, jacobian, points, whole = self.projected.rows(x, below)
        self.spent -= (self.projected.charge - self.projected.cost_charge) * int(np.sum(~np.asarray(whole)))
        return self._taken(Rows(r, jacobian, points), self.projected.charge, len(x))

    def projected_costs(self, x: np.ndarray) -> np.ndarray:
        """Costs (n,) of the projected problem at n points (n, q)."""
        assert self.projected is not None
        price = self.projected.cost_charge
        self._charge(len(x) * price)
        costs, points = self.projected.sample(x)
        for k in range(len(x)):
            self._record(points[k], float(costs[k]), float(costs[k]), self.spent - (len(x) - 1 - k) * price)
        self._after()
        return costs

    def _taken(self, rows: Rows, price: float, n: int) -> Rows:
        """Those of the first n points as plain arrays, recorded."""
        r, jacobian, points = (np.asarray(a, dtype=float)[:n] for a in (rows.r, rows.jacobian, rows.points))
        # residuals whose squares overflow cannot be compared either
        works = (
            np.all(np.abs(r) < 1e150, axis=1)
            & np.all(np.isfinite(jacobian), axis=(1, 2))
            & np.all(np.isfinite(points), axis=1)
        )
        rows = Rows(np.where(works[:, None], r, np.nan), np.where(works[:, None, None], jacobian, 0.0), points)
        costs = rows.squares / r.shape[1]
        for k in range(n):
            self._record(points[k], float(costs[k]), float(costs[k]), self.spent - (n - 1 - k) * price)
        self._after()
        return rows

    def blocks(self, x: np.ndarray, known: Sequence[Group | None] | None = None) -> list[Group]:
        """Residuals and derivatives of every separable group; a failed group has residuals that are not finite.

        Those that are `known` at their part of x, None for a group that is not, are not computed again.
        """
        assert self.objective.blocks is not None
        assert self.objective.separable is not None
        self._charge(self.objective.jacobian_charge)
        known = [None] * len(self.objective.separable) if known is None else known
        made = self.objective.blocks(x, np.array([k is None for k in known]))
        found = [m if k is None else k for m, k in zip(made, known, strict=True)]
        cost = float(sum(r @ r for r, _ in found))
        self._record(x, cost, cost, self.spent)
        self._after()
        return found

    def _charge(self, price: float) -> None:
        if self._stop is not None and self._stop():
            raise Interrupted("The search was stopped; what was finished is kept.")
        if self.spent + price > self.budget:
            raise BudgetSpent
        self.spent += price

    def _record(self, x: np.ndarray, cost: float, rank: float, spent: float) -> None:
        if not np.isfinite(cost):
            self.failures += 1
        elif rank < self._best_rank:
            self._best_rank, self.best_cost, self.best_x = rank, float(cost), np.array(x, dtype=float)
            self.history.append((float(spent), float(cost)))

    def _after(self) -> None:
        if self._report is not None:
            self._report(self)
        if self._target is not None and self.best_cost <= self._target:
            raise TargetReached
