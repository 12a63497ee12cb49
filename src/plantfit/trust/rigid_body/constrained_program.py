"""A smooth function minimised in the unit cube under inequalities, with the first-order conditions checked at the
answer."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize, nnls

from plantfit.runtime import jit

import jax
import jax.numpy as jnp

ACTIVE = 1e-7  # of the cube, or of a constraint's scale: closer than this counts as on it
NEWTON = 12  # steps of the last refinement


@dataclass(frozen=True)
class Program:
    """min objective(z, unit) over z (d,) in [0, 1] with inequalities(z) (q,) >= 0; both jax-traceable, scaled to about
    1.

    `unit` is what counts as 1 in the objective: the tolerances of all that follows are relative to it.
    """

    dimension: int
    objective: Callable[[Any, Any], Any]
    inequalities: Callable[[Any], Any]


@dataclass(frozen=True)
class Stationary:
    """A point with its multipliers: of z >= 0 (d,), of z <= 1 (d,), of the inequalities (q,).

    `residual` is the length of the gradient that multipliers >= 0 of active constraints leave; `violation` the largest
    of a constraint.
    """

    z: np.ndarray
    value: float
    multipliers: np.ndarray
    gradient_left: np.ndarray
    residual: float
    violation: float


class Solver:
    """The compiled derivatives of a program, for many starts."""

    def __init__(self, program: Program):
        self.program = program
        self.value = jit(jax.value_and_grad(program.objective))
        self.constraints = jit(lambda z: (program.inequalities(z), jax.jacfwd(program.inequalities)(z)))

        def lagrangian(z: Any, unit: Any, weights: Any) -> Any:
            return program.objective(z, unit) - weights @ program.inequalities(z)

        self.curvature = jit(jax.hessian(lagrangian))

    def solve(self, start: np.ndarray, unit: float = 1.0) -> Stationary:
        """A local minimum from `start` (d,): sequential quadratic programming (Kraft's SLSQP in scipy), then Newton's
        method on the constraints that are active."""
        inner = {
            "type": "ineq",
            "fun": lambda z: np.asarray(self.constraints(z)[0]),
            "jac": lambda z: np.asarray(self.constraints(z)[1]),
        }
        done = minimize(
            lambda z: tuple(np.asarray(v) for v in self.value(z, unit)), start, jac=True, method="SLSQP",
            bounds=[(0.0, 1.0)] * len(start),
            constraints=[inner], options={"maxiter": 300, "ftol": 1e-15},
        )  # fmt: skip
        return self.refined(np.clip(done.x, 0.0, 1.0), unit)

    def refined(self, z: np.ndarray, unit: float) -> Stationary:
        """The best of `z` and the points to which Newton's method on its active set leads."""
        best = self.stationary(z, unit)
        for _ in range(NEWTON):
            step = self._newton(best, unit)
            moved = self.stationary(np.clip(best.z + step, 0.0, 1.0), unit)
            if not (moved.residual + moved.violation < 0.9 * (best.residual + best.violation)):
                break
            best = moved
        return best

    def stationary(self, z: np.ndarray, unit: float) -> Stationary:
        """The point z with the multipliers that leave the least gradient (non-negative least squares)."""
        value, gradient = (np.asarray(v) for v in self.value(z, unit))
        level, slope = self._all(z)
        on = np.flatnonzero(level <= ACTIVE)
        found, left = nnls(slope[on].T, gradient) if len(on) else (np.zeros(0), float(np.linalg.norm(gradient)))
        multipliers = np.zeros(len(level))
        multipliers[on] = found
        return Stationary(
            z, float(value), multipliers, gradient - slope.T @ multipliers, float(left), max(0.0, float(-np.min(level)))
        )

    def _all(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bounds and inequalities: values (2 d + q,) and derivatives (2 d + q, d)."""
        inner, slope = (np.asarray(v) for v in self.constraints(z))
        eye = np.eye(len(z))
        return np.concatenate([z, 1.0 - z, inner]), np.vstack([eye, -eye, slope])

    def _newton(self, at: Stationary, unit: float) -> np.ndarray:
        """Step (d,) to a zero of the gradient of the Lagrangian with the pressed constraints kept at zero; the
        shortest where flat."""
        d = len(at.z)
        level, slope = self._all(at.z)
        on = np.flatnonzero((at.multipliers > 0) | (level < 0))
        hessian = np.asarray(self.curvature(at.z, unit, jnp.asarray(at.multipliers[2 * d :])))
        matrix = np.block([[hessian, -slope[on].T], [slope[on], np.zeros((len(on), len(on)))]])
        return np.linalg.lstsq(matrix, -np.concatenate([at.gradient_left, level[on]]), rcond=1e-12)[0][:d]
