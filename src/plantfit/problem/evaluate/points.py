"""Residuals with derivatives at single points, by the compiled function that searches side by side use too.

Every shape that a loop is compiled for costs tenths of a second before its first number. In a small problem a point
filled up to the width of a search costs microseconds more, so that choosing steps, search, finish and verdict share one
shape.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np

from plantfit.native.kept_programs import Kept
from plantfit.problem.evaluate.triangle import compressed as compressed_blocks
from plantfit.problem.problem import Problem
from plantfit.runtime import jit
from plantfit.simulate.simulator import Drive

import jax

WIDTH = 4  # points evaluated together, as many as `plantfit.optimize` hands over at once (`TOGETHER`)
DIFFERENCE = 1e-5  # of the box, to either side
# entries of a Jacobian, or steps times coordinates, up to which the points beside the one wanted cost little
SMALL = 50_000


@lru_cache(maxsize=16)
def several(function: Callable) -> Callable:
    """Of one compiled function of (z, arguments) that for several z."""
    many = jax.vmap(function, in_axes=(0, None))
    return Kept(many, f"{function.name} of several", function.description) if isinstance(function, Kept) else jit(many)


def shared(problem: Problem) -> bool:
    """Whether single points are evaluated `WIDTH` at once: small problems that are no regression and do not fall
    apart."""
    if problem.predictor.simulator is None or problem.separable is not None:
        return False
    samples = sum(problem.parts.counts.values())
    # a mesh may have thousands of steps for a handful of samples
    steps = sum(len(d.t) for d in problem.data["drive"].values() if isinstance(d, Drive)) if problem.mesh else 0
    return max(samples, steps) * problem.space.dimension <= SMALL


def residuals_and_jacobian(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `Problem.residuals_and_jacobian`: residuals (m,) and derivatives (m, d) at a cube point (d,).

    A simulation may be finite where terms of its derivatives overflow, as x^n does for n = 60: inf/inf. Columns that
    are no numbers become central differences; those that are none either stay as they are.
    """
    r, jacobian = _exact(problem, z)
    if np.all(np.isfinite(jacobian)) or not np.all(np.isfinite(r)):
        return r, jacobian
    jacobian = jacobian.copy()
    for k in np.flatnonzero(~np.all(np.isfinite(jacobian), axis=0)):
        low, high = np.array(z, dtype=float), np.array(z, dtype=float)
        low[k], high[k] = max(low[k] - DIFFERENCE, 0.0), min(high[k] + DIFFERENCE, 1.0)
        jacobian[:, k] = (_exact(problem, high)[0] - _exact(problem, low)[0]) / (high[k] - low[k])
    return r, jacobian


def _exact(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not shared(problem):
        return problem.residuals_and_jacobian(z)
    zs = np.repeat(np.asarray(z, dtype=float)[None, :], WIDTH, axis=0)
    r, jacobian = several(problem.compiled["residuals_and_jacobian"])(zs, problem.arguments)
    return np.asarray(r)[0], np.asarray(jacobian)[0]


def at_several(problem: Problem, zs: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Residuals (m,) and derivatives (m, d) at cube points (k, d), one after the other."""
    if not shared(problem):
        yield from (problem.residuals_and_jacobian(z) for z in zs)
        return
    for begin in range(0, len(zs), WIDTH):
        some = np.asarray(zs[begin : begin + WIDTH], dtype=float)
        filled = np.concatenate([some, np.repeat(some[-1:], WIDTH - len(some), axis=0)])
        r, jacobian = several(problem.compiled["residuals_and_jacobian"])(filled, problem.arguments)
        yield from zip(np.asarray(r)[: len(some)], np.asarray(jacobian)[: len(some)], strict=True)


def compressed(problem: Problem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `Problem.compressed`: residuals (k,) and derivatives (k, d) in few rows."""
    if not shared(problem):
        return problem.compressed(z)
    r, jacobian = residuals_and_jacobian(problem, z)
    return compressed_blocks([(r, jacobian, np.arange(problem.space.dimension))], problem.space.dimension)


def residuals(problem: Problem, z: np.ndarray) -> np.ndarray:
    """As `Problem.residuals` (m,); where points share a function, by that, which a search with these steps compiles
    anyway."""
    data = problem.unsmoothed
    return residuals_and_jacobian(data, z)[0] if shared(data) else np.asarray(data.residuals(z))


def residuals_alone(problem: Problem, z: np.ndarray) -> np.ndarray:
    """The same residuals (m,), by a function without derivatives: for steps that may never be searched with."""
    data = problem.unsmoothed
    if not shared(data):
        return np.asarray(data.residuals(z))
    zs = np.repeat(np.asarray(z, dtype=float)[None, :], WIDTH, axis=0)
    return np.asarray(several(data.compiled["residuals"])(zs, data.arguments))[0]
