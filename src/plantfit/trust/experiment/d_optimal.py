"""The experiment that would tell most: D-optimal designs within limits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective
from plantfit.runtime import jit
from plantfit.trust.verdict.words import number, some

import jax
import jax.numpy as jnp

OUTSIDE = 1e6  # cost of a design that breaks a limit, to which its violation is added


@dataclass(frozen=True)
class Experiment:
    """A design (d,) with its `information` (k, k), its log-determinant and the sum of its violations, 0 within all
    limits."""

    design: np.ndarray
    information: np.ndarray
    log_det: float
    violation: float
    evaluations: float = 0.0

    def standard_errors(self) -> np.ndarray:
        """Standard errors (k,) of the parameters, in the units of the information."""
        return np.sqrt(np.diag(np.linalg.inv(self.information)))


def d_optimal(
    information: Callable[[Any], Any],
    violation: Callable[[Any], Any] | None,
    bounds: tuple[Any, Any],
    method: str = "cmaes",
    budget: int = 2000,
    seed: int = 0,
    start: Any = None,
    settings: Mapping[str, Any] | None = None,
) -> Experiment:
    """The design in `bounds` (lower (d,), upper (d,)) with the largest log det of its information (k, k).

    `information` and `violation` (any shape, > 0 where a limit is broken, in units that can be added up) are
    jax-traceable functions of a design (d,); with `violation` None, `information` gives both, so that one simulation
    serves both. A design that breaks a limit is worse than any that does not, and the more the more it breaks (Deb,
    Comput. Methods Appl. Mech. Eng. 186 (2000) 311, eq. 4). `start` (d,) or (m, d) are designs to begin from; `method`
    is any of `plantfit methods` without a gradient. D-optimality: Fedorov, Theory of Optimal Experiments, 1972, section
    2.1. Raises SearchError for bounds that cannot be, and when no design of `budget` tries keeps all limits.
    """
    low, high = (np.asarray(b, dtype=float) for b in bounds)
    if low.ndim != 1 or low.shape != high.shape or not np.all(low < high):
        raise SearchError(
            f"The bounds of the design have shapes {low.shape} and "
            f"{high.shape}; give a lower below an upper bound for each number."
        )

    def measured(design: Any) -> tuple[Any, Any, Any]:
        matrix, broken = information(design) if violation is None else (information(design), violation(design))
        size = jnp.sqrt(jnp.maximum(jnp.diag(matrix), 1e-300))
        sign, log_det = jnp.linalg.slogdet(matrix / jnp.outer(size, size))  # units apart, or small ones are lost
        total = jnp.sum(jnp.maximum(jnp.ravel(jnp.asarray(broken)), 0.0))
        return matrix, jnp.where(sign > 0, log_det, -jnp.inf) + 2.0 * jnp.sum(jnp.log(size)), total

    def costs(cube: Any) -> Any:
        _, log_det, total = jax.vmap(measured)(low + (high - low) * cube)
        cost = jnp.where(total > 0, OUTSIDE + total, -log_det)
        return jnp.where(jnp.isnan(cost), jnp.inf, cost)

    cubes = None if start is None else (np.atleast_2d(np.asarray(start, dtype=float)) - low) / (high - low)
    if cubes is not None and (cubes.shape[1] != len(low) or np.any(cubes < -1e-9) or np.any(cubes > 1 + 1e-9)):
        raise SearchError(f"The start of the design does not lie in its bounds; give {len(low)} numbers inside.")
    objective = Objective(
        len(low), costs, start=None if cubes is None else np.clip(cubes, 0.0, 1.0), lower=low, upper=high
    )
    (run,) = minimise(objective, method, budget=budget, seed=seed, settings=settings)
    if not run.cost < OUTSIDE:
        said = f"breaks limits by {run.cost - OUTSIDE:.3g}" if np.isfinite(run.cost) else "cannot be evaluated"
        raise SearchError(
            f"No design keeps all limits: the best of {budget} {said}; "
            "widen the limits or give a start that keeps them."
        )
    design = low + (high - low) * run.x
    matrix, log_det, total = (np.asarray(v) for v in jit(measured)(jnp.asarray(design)))
    return Experiment(design, matrix, float(log_det), float(total), run.evaluations)


@dataclass(frozen=True)
class Gain:
    """What one experiment tells more than another: `log_det` the difference, `error_ratio` (k,) standard errors new
    / old."""

    names: tuple[str, ...]
    log_det: float
    error_ratio: np.ndarray

    @property
    def sentence(self) -> str:
        k = len(self.names)
        mean = float(np.exp(-self.log_det / (2 * k)))
        each = [f"{n} {number(r)}" for n, r in zip(self.names, self.error_ratio, strict=True)]
        grown = (
            f"The log-determinant of the information {'grows' if self.log_det >= 0 else 'falls'} by "
            f"{number(abs(self.log_det))}"
        )
        return (
            f"{grown}: standard errors become {number(mean)} times as large in the mean of all axes "
            f"({some(each, most=8)})."
        )


def gain(names: Sequence[str], new: Any, old: Any) -> Gain:
    """Compare two informations (k, k) about the same parameters with the same noise.

    Raises SearchError where one of them is singular.
    """
    errors, log_dets = [], []
    for which, matrix in (("new", np.asarray(new, dtype=float)), ("old", np.asarray(old, dtype=float))):
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix / np.outer(size, size)
        if np.linalg.eigvalsh(scaled)[0] <= 1e-14:
            raise SearchError(
                f"The information of the {which} experiment is singular; compare it over its base parameters."
            )
        errors.append(np.sqrt(np.diag(np.linalg.inv(scaled))) / size)
        log_dets.append(np.linalg.slogdet(scaled)[1] + 2.0 * np.sum(np.log(size)))
    return Gain(tuple(names), float(log_dets[0] - log_dets[1]), errors[0] / errors[1])
