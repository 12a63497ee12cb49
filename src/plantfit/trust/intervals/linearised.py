"""A problem linearised at an answer: covariance, bounds that hold, directions that stay open."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

import plantfit.runtime  # noqa: F401
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.problem.correlated.weighted_answer import Weighted
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.evaluate.triangle import triangle
from plantfit.problem.measure.long_run import NORMAL
from plantfit.problem.measure.scale_source import GIVEN
from plantfit.problem.problem import Problem
from plantfit.space import Space
from plantfit.trust.finish.unknown_noise import as_known, unknown_noise
from plantfit.trust.identify.directions import Direction, flat_directions
from plantfit.trust.intervals.covariance import (
    Begins,
    Block,
    covariance,
    effective_parameters,
    known_variance,
    normal_matrix,
)
from plantfit.trust.intervals.first_values import first_value_effects
from plantfit.trust.intervals.ranges import FAR, Linear, linear_problem, plain_space
from plantfit.trust.intervals.robust_or_classical import robust_errors

EDGE = 1e-6  # of the cube: closer to a bound counts as on it
EXACT = 1e-14  # an eigenvalue of a correlation that is rounding
MOST_BOUNDED = 40  # coordinates up to which the others' bounds are kept when one on its bound is judged
OPEN = (
    0.2  # of the cube: a value that may move so far unnoticed is not determined (see `trust.intervals.parameter_rows`)
)


@dataclass(frozen=True)
class Local:
    """The linearised problem at an answer: values and covariance (d,), (d, d) in the parameters' units.

    `linear` is the problem that ranges are read from (`trust/intervals/ranges.py`): every parameter is free there
    within its physical limits, also one that a bound holds, and no box makes errors smaller. Problems with tables or
    with more than 60 coordinates have none; their covariance takes the box as prior. `effective` (d,) tells how far the
    data and not the box or a smoothing fix each value, 0 to 1; `touched` (d,) whether any residual depends on it at
    all. `unboxed` (d,), where there is no `linear`: standard errors with no other prior than a smoothing, so that
    statuses do not depend on where was searched; 0 where a physical limit holds a value. `robust`: whether the
    covariance allows for residuals that are correlated in time.
    """

    values: np.ndarray
    covariance: np.ndarray
    standard_error: np.ndarray
    at_bound: tuple[str | None, ...]
    directions: tuple[Direction, ...]
    effective: np.ndarray
    touched: np.ndarray
    linear: Linear | None = None
    robust: bool = True
    unboxed: np.ndarray | None = None


def linearise(problem: Problem, z: np.ndarray) -> Local:
    """Covariance and flat directions at the cube point z (d,); outputs whose errors nobody knows fix nothing
    (`unknown_noise`). At the answer of another estimator (`Problem.own_estimate`) they are that one's."""
    weighted = problem.own_estimate
    if weighted is not None and np.array_equal(z, weighted.z):
        return _by_weights(linearise(problem.with_answer(None), z), weighted)
    problem = as_known(problem)
    space, blocks = problem.space, residual_blocks(problem)
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    smoothing = problem.smoothing.matrix if problem.smoothing else np.zeros((space.dimension,) * 2)
    bends = problem.smoothing.weighted(z) if problem.smoothing else (np.zeros(0), np.zeros((0, space.dimension)))
    lower, upper = _held(z, np.vstack([jacobian, bends[1]]), np.r_[residuals, bends[0]])
    free = ~((lower & _physical(space, 0)) | (upper & _physical(space, 1)))  # a bound of the search holds nothing
    values, slope = np.asarray(space.physical(z)), space.slopes(z)
    linear, unboxed, begins = None, None, first_value_effects(problem, z, blocks)
    robust = robust_errors(problem, residuals, blocks)
    if plain_space(problem):
        linear = linear_problem(problem, z, residuals, jacobian, blocks, robust, begins=begins)
        physical = linear.spread * linear.size[:, None] * linear.size[None, :]
    else:
        cube = covariance(jacobian, residuals, blocks, free, smoothing, robust, begins)
        physical = cube * slope[:, None] * slope[None, :]
        unboxed = _unboxed(space, values, slope, jacobian, residuals, blocks, free, smoothing, robust, begins)
    variance = float(residuals @ residuals) / max(1, len(residuals) - int(free.sum()))
    variance = max(variance, known_variance(blocks, len(residuals), int(free.sum())))
    information = (
        (normal_matrix(jacobian, blocks) + smoothing) / max(variance, 1e-300) / slope[:, None] / slope[None, :]
    )
    on = np.flatnonzero(free)
    directions = flat_directions(
        information[np.ix_(on, on)], values[on], (space.upper - space.lower)[on], tuple(space.names[i] for i in on)
    )
    bound = tuple("lower" if a else "upper" if b else None for a, b in zip(lower, upper, strict=True))
    effective = effective_parameters(jacobian[:, on], blocks, smoothing[np.ix_(on, on)], variance)
    known = np.zeros(space.dimension)
    known[on] = effective
    return Local(
        values, physical, np.sqrt(np.maximum(np.diag(physical), 0.0)), bound, tuple(directions), known,
        np.any(jacobian != 0.0, axis=0),
        linear, robust, unboxed,
    )  # fmt: skip


def _by_weights(local: Local, weighted: Weighted | Filtered) -> Local:
    """The same with the covariance of another estimator, and ranges that follow from it."""
    assert local.linear is not None
    size, covariance = local.linear.size, weighted.covariance
    spread = covariance / np.outer(size, size)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    own = np.maximum(errors / size, 1e-300)
    squares, vectors = np.linalg.eigh(spread / np.outer(own, own))
    rows = (vectors / np.sqrt(np.maximum(squares, EXACT))).T / own
    linear = replace(
        local.linear, rows=rows, rest=np.zeros(len(size)), spread=spread,
        threshold=np.full(len(size), NORMAL**2), quantile=NORMAL, sound=True, begun=np.ones(len(size)), turn=None,
        turned=None,
    )  # fmt: skip
    return replace(local, covariance=covariance, standard_error=errors, linear=linear)


def natural_sizes(space: Space, values: np.ndarray) -> np.ndarray:
    """What a change of each of the `values` (d,) is large against: the value, the size that matters, half of the
    median of its table."""
    groups: dict[tuple[str, str | None], list[int]] = {}
    for i, c in enumerate(space.coordinates):
        groups.setdefault((c.parameter, c.recording), []).append(i)
    sizes = np.array([max(abs(float(v)), c.typical) for v, c in zip(values, space.coordinates, strict=True)])
    for own in groups.values():
        sizes[own] = np.maximum(sizes[own], 0.5 * float(np.median(np.abs(values[own]))))
    return sizes


def _unboxed(
    space: Space,
    values: np.ndarray,
    slope: np.ndarray,
    jacobian: np.ndarray,
    residuals: np.ndarray,
    blocks: list[Block],
    free: np.ndarray,
    smoothing: np.ndarray,
    robust: bool,
    begins: Begins,
) -> np.ndarray:
    """Standard errors (d,) in the parameters' units where nothing but a smoothing is known beside the data.

    In coordinates of natural size, in which nothing moves further than `FAR`, as where ranges are made.
    """
    size = natural_sizes(space, values)
    size = np.where(size > 0.0, size, space.upper - space.lower)  # of a table of zeros nothing is known
    by = size / slope
    found = covariance(
        jacobian * by,
        residuals,
        blocks,
        free,
        smoothing * np.outer(by, by),
        robust,
        begins,
        np.full(len(values), FAR**-2.0),
    )
    return np.sqrt(np.maximum(np.diag(found), 0.0)) * size


def _physical(space: Space, side: int) -> np.ndarray:
    """Whether the lower (0) or upper (1) bound of each coordinate (d,) is where its physical limit is."""
    bounds = (space.lower, space.upper)[side]
    limits = np.array([c.limits[side] for c in space.coordinates])
    return np.abs(bounds - limits) <= EDGE * (space.upper - space.lower)


def _held(z: np.ndarray, jacobian: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (d,) that the data press onto their lower and upper bound.

    A coordinate is open, and only happens to stand on its bound, where it could move inside by a fifth of the box and
    chi-squared would grow by less than 1 after the others have moved inside their bounds to make up for it: of two
    parameters known only as a sum, the one on its bound is not pressed.
    """
    gradient, curvature = jacobian.T @ residuals, np.sum(jacobian**2, axis=0)
    variance = max(float(residuals @ residuals) / max(1, len(residuals) - len(z)), 1e-300)
    alone = 2.0 * OPEN * np.abs(gradient) + OPEN**2 * curvature >= variance
    lower, upper = (z <= EDGE) & (gradient >= 0) & alone, (z >= 1 - EDGE) & (gradient <= 0) & alone
    if np.any(lower | upper):
        small = triangle(jacobian, residuals)
        for i in np.flatnonzero(lower | upper):
            pressed = _growth(z, small[:, :-1], small[:, -1], int(i), OPEN if lower[i] else -OPEN) >= variance
            lower[i], upper[i] = lower[i] and pressed, upper[i] and pressed
    return lower, upper


def _growth(z: np.ndarray, jacobian: np.ndarray, residuals: np.ndarray, i: int, step: float) -> float:
    """How much the linearised sum of squares grows when coordinate i moves by `step` and the others follow as they
    best can."""
    others = np.arange(len(z)) != i
    if len(z) > MOST_BOUNDED:  # those inside the box follow; whether they stay there is not looked at
        others &= (z > EDGE) & (z < 1 - EDGE)
    moved, columns = residuals + step * jacobian[:, i], jacobian[:, others]
    if not np.any(others):
        left = moved
    elif len(z) > MOST_BOUNDED:
        left = moved + columns @ np.linalg.lstsq(columns, -moved, rcond=1e-12)[0]
    else:
        norms = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        low, high = -z[others] * norms, (1.0 - z[others]) * norms
        follow = lsq_linear(columns / norms, -moved, (low - 1e-15 * norms, high + 1e-15 * norms), method="bvls")
        left = moved + (columns / norms) @ follow.x
    return float(left @ left) - float(residuals @ residuals)


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Errors (m,) that samples share as whole numbers; samples without one get numbers of their own beyond."""
    unknown = np.isnan(numbers)
    last = np.max(numbers[~unknown], initial=0.0)
    return np.where(unknown, last + np.cumsum(unknown), numbers).astype(int)


def named_blocks(problem: Problem) -> list[tuple[str, str, Block]]:
    """(recording, output, where their residuals stand), in the order of the residuals."""
    blocks, start, silent = [], 0, unknown_noise(problem)
    for name in problem.data["drive"]:
        for output in problem.outputs:
            index = problem.data["index"][name][output]
            if len(index):
                numbers = problem.experiments[name].error_numbers(output)
                own = index if numbers is None else _whole(numbers[index])
                scaled = problem.scale_sources[output] == GIVEN or output in silent
                blocks.append((name, output, Block(slice(start, start + len(index)), own, output, scaled)))
            start += len(index)
    return blocks


def residual_blocks(problem: Problem) -> list[Block]:
    """Where the residuals of every output in every recording stand."""
    return [block for _, _, block in named_blocks(problem)]
