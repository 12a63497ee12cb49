"""The least-squares optimum of a regression whose coefficients are functions of bounded, constrained parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.problem.evaluate.compress import Compressed
from plantfit.trust.identify.combinations import Base, stacked
from plantfit.trust.rigid_body.constrained_program import Program, Solver, Stationary
from plantfit.trust.rigid_body.feasibility import Constraints
from plantfit.trust.verdict.words import number, some

import jax
import jax.numpy as jnp

SAME = 1e-9  # relative difference of costs that counts as the same optimum
POSSIBLE = 1e-8  # of a constraint's scale: violated by less is kept


@dataclass(frozen=True)
class Optimum:
    """The lowest mean square inside box and constraints.

    `values` by name, `coefficients` (k,); `cost` the mean square, `rmse` its root; `free_cost` that of plain least
    squares on the coefficients; `active` what holds it there, in words; `kkt` the gradient that no active constraint
    holds, as relative change of the cost per width of the box; `agreeing` of `starts` that ended at this cost.
    """

    values: dict[str, float]
    coefficients: np.ndarray
    cost: float
    free_cost: float
    active: tuple[str, ...]
    kkt: float
    starts: int
    agreeing: int

    @property
    def rmse(self) -> float:
        return float(np.sqrt(self.cost))

    @property
    def inside(self) -> bool:
        """True when no bound or constraint costs anything: plain least squares is possible."""
        return self.cost <= self.free_cost * (1 + SAME) + 1e-300

    @property
    def sentence(self) -> str:
        found = (
            f"{self.agreeing} of {self.starts} starts end there, first-order conditions to {max(self.kkt, 1e-16):.0e}"
        )
        if self.inside:
            return (
                f"The least-squares optimum, RMSE {self.rmse:.6g}, is physically possible: no bound or constraint "
                f"presses ({found})."
            )
        more = number(100.0 * (self.rmse / np.sqrt(self.free_cost) - 1.0)) if self.free_cost > 0 else "infinitely many"
        above = f"The constrained optimum has RMSE {self.rmse:.6g}, {more} % above plain least squares"
        return f"{above}; what holds it there: {some(self.active, most=8)} ({found})."


def constrained_optimum(
    compressed: Compressed,
    base: Base,
    names: Sequence[str],
    lower: Any,
    upper: Any,
    constraints: Constraints | None = None,
    starts: int = 16,
    seed: int = 0,
) -> Optimum:
    """Minimum of |y - W base(p)|^2 / n over lower <= p <= upper (d,) with every constraint(p) >= 0, by many starts.

    `compressed` is `compress(W, y)` (`problem/evaluate/compress.py`), `base` maps named parameters to the k
    coefficients (jax-traceable). Starts are drawn uniformly from the box. To know that a minimum is global see
    `certified_floor`. Raises ModelError for a box without width, or when no start reaches a point that satisfies the
    constraints.
    """
    low, high = _box(names, lower, upper)
    task = RegressionTask(compressed, base, tuple(names), low, high, constraints or {})
    solver = Solver(task.program())
    points = np.random.default_rng(seed).uniform(0.0, 1.0, (starts, len(low)))
    ends = [s for s in (solver.solve(z) for z in points) if s.violation <= POSSIBLE and np.isfinite(s.value)]
    if not ends:
        raise ModelError(
            f"No point of the box satisfies {some(list(task.constraints), most=8)}: "
            f"none of {starts} starts reached one; widen the bounds."
        )
    # once more with what is left above plain least squares as the unit, so that rounding is judged against it
    reached = min(task.cost(e.z) for e in ends)
    unit = max((reached - float(compressed.rest) / float(compressed.n)) / task.unit, 1e-9 * reached / task.unit, 1e-13)
    refined = sorted((solver.solve(e.z, unit) for e in ends), key=lambda s: s.value)
    kept = [s for s in refined if s.violation <= POSSIBLE] or refined
    costs = [task.cost(s.z) for s in kept]
    same = costs[0] * (1 + SAME) + 1e-26 * task.unit  # of exact data only rounding is left
    agreeing = [s for s, c in zip(kept, costs, strict=True) if c <= same]
    return _told(task, min(agreeing, key=lambda s: s.residual), unit, starts, len(agreeing))


@dataclass(frozen=True)
class RegressionTask:
    """The regression as a program over the unit cube."""

    compressed: Compressed
    base: Base
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    constraints: Constraints

    @property
    def unit(self) -> float:
        """Mean square of the target: 1 in the program's objective."""
        c = self.compressed
        return max(float(np.asarray(c.projected) @ np.asarray(c.projected) + c.rest) / float(c.n), 1e-300)

    def point(self, z: Any) -> Any:
        return self.low + (self.high - self.low) * z

    def coefficients(self, z: Any) -> Any:
        return stacked(self.base, self.names)(self.point(z))

    def cost(self, z: np.ndarray) -> float:
        """Mean square at a cube point."""
        miss = np.asarray(self.compressed.R) @ np.asarray(self.coefficients(jnp.asarray(z))) - np.asarray(
            self.compressed.projected
        )
        return float((miss @ miss + self.compressed.rest) / self.compressed.n)

    def program(self) -> Program:
        """Mean square in units of that of the target, and the constraints by their sizes over the box."""
        c, scales = self.compressed, self._scales()
        r, target, over = jnp.asarray(c.R), jnp.asarray(c.projected), float(c.n) * self.unit

        def objective(z: Any, unit: Any) -> Any:
            return jnp.sum((r @ self.coefficients(z) - target) ** 2) / (over * unit)

        def inequalities(z: Any) -> Any:
            return self._levels(self.point(z)) / scales

        return Program(len(self.low), objective, inequalities)

    def _levels(self, point: Any) -> Any:
        named = {n: point[i] for i, n in enumerate(self.names)}
        return (
            jnp.stack([jnp.asarray(f(named), dtype=float) for f in self.constraints.values()])
            if self.constraints
            else jnp.zeros(0)
        )

    def _scales(self) -> np.ndarray:
        points = np.random.default_rng(0).uniform(self.low, self.high, (64, len(self.low)))
        levels = np.abs(np.asarray(jax.vmap(self._levels)(jnp.asarray(points))))
        return np.maximum(levels.max(axis=0), 1e-300) if levels.size else np.ones(len(self.constraints))


def _told(task: RegressionTask, best: Stationary, unit: float, starts: int, agreeing: int) -> Optimum:
    c = task.compressed
    pressed = np.flatnonzero(best.multipliers > 1e-9 * max(1.0, float(np.max(best.multipliers))))
    free, *_ = np.linalg.lstsq(np.asarray(c.R), np.asarray(c.projected))
    left = np.asarray(c.R) @ free - np.asarray(c.projected)
    cost, free_cost = task.cost(best.z), float((left @ left + c.rest) / c.n)
    inside = cost <= free_cost * (1 + SAME)
    words = [
        *(f"{n} at its lower bound" for n in task.names),
        *(f"{n} at its upper bound" for n in task.names),
        *task.constraints,
    ]
    point = task.point(best.z)
    kkt = best.residual * unit * task.unit / max(cost, 1e-300)
    return Optimum(
        {n: float(v) for n, v in zip(task.names, point, strict=True)},
        np.asarray(task.coefficients(jnp.asarray(best.z))),
        cost, free_cost, () if inside else tuple(words[i] for i in pressed), kkt, starts, agreeing,
    )  # fmt: skip


def _box(names: Sequence[str], lower: Any, upper: Any) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != (len(names),) or high.shape != low.shape or not np.all(low < high):
        raise ModelError(
            f"The box has shapes {low.shape} and {high.shape} for {len(names)} "
            "parameters; give a lower below an upper bound for each."
        )
    return low, high
