"""A problem as a search sees it: a cube and numbers."""

import hashlib
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.kept_programs import kept
from plantfit.optimize.contract import KeptCosts, Objective
from plantfit.problem.evaluate.points import several
from plantfit.problem.evaluate.projection import Projection
from plantfit.problem.evaluate.triangle import triangle
from plantfit.problem.problem import Problem

SIDE_BY_SIDE = 500_000  # entries of a Jacobian of which several fit into memory at once


def _in_few_rows(zs: np.ndarray, r: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n, k) and derivatives (n, k, d) with the mean square, gradient and Gauss-Newton matrix of (n, m) and
    (n, m, d).

    Points zs (n, d) that are the first once more, with which a search fills up, cost no decomposition of their own.
    """
    _, m, d = jacobian.shape
    if m <= d + 1:
        return r, jacobian
    first = triangle(jacobian[0], r[0])
    again = np.all(zs == zs[0], axis=1)
    small = np.stack(
        [first if same else triangle(*pair) for same, *pair in zip(again, jacobian, r, strict=True)]
    ) * np.sqrt((d + 1) / m)
    return small[:, :, d], small[:, :, :d]


def objective_of(problem: Problem, start: np.ndarray | None = None) -> Objective:
    """The cost with its derivatives; `start` (k, d) are cube points to begin from, by default the guesses of the
    space."""
    if start is None and problem.space.start is not None:
        start = problem.space.start[None, :]

    def batch(zs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if regression:  # its one block has few rows, with the same mean square
            r, jacobian = several(problem.compiled["blocks"])(zs, problem.arguments)[0]
            return np.asarray(r), np.asarray(jacobian)
        return _in_few_rows(
            zs, *map(np.asarray, several(problem.compiled["residuals_and_jacobian"])(zs, problem.arguments))
        )

    regression = "triangles" in problem.data
    samples = 0 if regression else sum(problem.parts.counts.values())
    small = samples * problem.space.dimension <= SIDE_BY_SIDE
    return Objective(
        dimension=problem.space.dimension,
        costs=KeptCosts(problem.costs, problem.kept, kept),
        value_and_gradient=problem.value_and_gradient,
        residuals_and_jacobian=problem.residuals_and_jacobian,
        compressed=problem.compressed,
        batch_rows=batch if small else None,
        projected=lambda: Projection.of(problem),
        separable=problem.separable,
        blocks=problem.separable_blocks,
        gradient_charge=problem.gradient_charge,
        jacobian_charge=problem.jacobian_charge,
        start=start,
        lower=problem.space.lower,
        upper=problem.space.upper,
        log=problem.space.log,
        held=_held(problem),
    )


def _held(problem: Problem) -> float:
    """A number of what no coordinate shows: held values, and the nodes of tables."""
    own = [(n, _told(p.value)) for n, p in sorted(problem.space.parameters.items()) if p.value is not None]
    nodes = [(t.name, [_told(n) for n in t.nodes]) for t in getattr(problem.model, "tables", ())]
    digest = hashlib.sha256(repr((own, nodes)).encode()).digest()
    return float(int.from_bytes(digest[:6], "big"))  # a float holds 48 bits exactly


def _told(values: Any) -> list[str]:
    """Numbers in so many digits as no other machine changes."""
    return [f"{v:.12g}" for v in np.ravel(np.asarray(values, dtype=float))]
