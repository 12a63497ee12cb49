"""Refits of records made of the answer's outputs and of blocks of its residuals, drawn anew."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr, ndtri

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.measure.long_run import first_correlation
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.covariance import errors_at
from plantfit.trust.intervals.first_values import FreeStarts, free_starts
from plantfit.trust.intervals.linearised import EDGE, named_blocks, residual_blocks

TIMES = 10  # correlation times of the residuals in a block
SHARE = 0.25  # of a record that a block holds at most
EVALUATIONS = 40  # of a refit
SAME = 1e-6  # of the cost: least gain that a refit goes on for


@dataclass(frozen=True)
class Bootstrap:
    """`values` (n, d) of the refits in the parameters' units, samples in a `block` of each output, and how many
    refits were `lost` because the plant could not be simulated on their way."""

    values: np.ndarray
    block: dict[str, int]
    lost: int


def bootstrap(
    problem: Problem,
    z: np.ndarray,
    replicates: int,
    seed: int = 1,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> Bootstrap:
    """`replicates` refits from the cube point z (d,).

    Residuals are drawn in blocks that overlap and run round the end of a record, as long as ten times their correlation
    time (Politis and Romano, in Exploring the Limits of Bootstrap, 1992, p. 263), and made larger by what the fit took
    from them. Each refit begins at z and stays within the bounds. Starts that the fit has estimated are free in each;
    other initial values that are read from a record's first samples keep them. Errors of an output with no more samples
    than there are free parameters are normal: its residuals are smaller than its errors, which its scale tells.
    """
    data, space = problem.unsmoothed, problem.space
    r, jacobian = residuals_and_jacobian(data, z)
    rng = np.random.default_rng(seed)
    lengths, series = _series(problem, r)
    errors, starts = errors_at(r, jacobian, residual_blocks(data)), free_starts(data, z, residual_blocks(data))
    values, lost = [], 0
    for k in range(replicates):
        shift = np.zeros_like(r)
        for output, rows in series:
            own = errors[output]
            if own.least:
                shift[rows] = rng.normal(scale=np.sqrt(own.mean_square(r[rows])), size=len(rows)) - r[rows]
            else:
                shift[rows] = _drawn(r[rows] - r[rows].mean(), lengths[output], rng) * np.sqrt(own.larger) - r[rows]
        if starts is not None and (more := len(starts.columns) - len(r)):  # first values that are no fitted samples
            shift = np.r_[shift, np.sqrt(np.mean(r**2)) * rng.standard_normal(more)]
        found = _refitted(data, z, shift, starts)
        if found is None:
            lost += 1
        else:
            values.append(np.asarray(space.physical(found)))
        tell(k + 1, replicates)
    return Bootstrap(np.array(values).reshape(-1, len(z)), lengths, lost)


def percentiles(values: np.ndarray, at: float, level: float, bounds: tuple[float, float]) -> tuple[float, float]:
    """(low, high) of refitted values (n,), corrected for the share of them below the answer's value (Efron, J. Am.
    Stat. Assoc. 82 (1987) 171, without acceleration); as they are where that value stands on a bound, beyond which
    no refit can be."""
    n, near = len(values), EDGE * (bounds[1] - bounds[0])
    if at <= bounds[0] + near or at >= bounds[1] - near:
        low, high = np.quantile(values, [0.5 - level / 2, 0.5 + level / 2])
        return float(low), float(high)
    below = (np.sum(values < at) + 0.5 * np.sum(values == at)) / n
    shift = float(ndtri(np.clip(below, 0.5 / n, 1 - 0.5 / n)))
    tails = [float(ndtr(2 * shift + ndtri(q))) for q in (0.5 - level / 2, 0.5 + level / 2)]
    low, high = np.quantile(values, tails)
    return float(low), float(high)


def _series(problem: Problem, r: np.ndarray) -> tuple[dict[str, int], list[tuple[str, np.ndarray]]]:
    """Samples in a block of each output, and (output, rows) of each recording."""
    series, memory = [], {}
    for _, output, block in named_blocks(problem):
        rows = np.arange(block.rows.start, block.rows.stop)
        series.append((output, rows))
        memory.setdefault(output, []).append(float(first_correlation(r[rows][:, None])[0]))
    lengths = {}
    for output, found in memory.items():
        shortest = min(len(rows) for o, rows in series if o == output)
        rho = float(np.clip(np.mean(found), 0.0, 0.999))
        chance = rho < 2.0 / np.sqrt(sum(len(rows) for o, rows in series if o == output))  # what white noise shows too
        lengths[output] = 1 if chance else int(np.clip(np.ceil(-TIMES / np.log(rho)), 1, max(1, SHARE * shortest)))
    return lengths, series


def _drawn(series: np.ndarray, length: int, rng: np.random.Generator) -> np.ndarray:
    """As many values (n,), in blocks that begin anywhere."""
    n = len(series)
    starts = rng.integers(0, n, size=-(-n // length))
    return series[(starts[:, None] + np.arange(length)).ravel()[:n] % n]


def _refitted(problem: Problem, z: np.ndarray, shift: np.ndarray, starts: FreeStarts | None) -> np.ndarray | None:
    """The cube point (d,) nearest to data that lie `shift` (m,) away, the `starts` free; None where the plant cannot be
    simulated."""
    last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    if starts is not None:
        shift = starts.left(shift)

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if (key := x.tobytes()) not in last:
            last.clear()
            r, jacobian = residuals_and_jacobian(problem, x)
            r, jacobian = np.nan_to_num(r, nan=1e100, posinf=1e100, neginf=-1e100), np.nan_to_num(jacobian)
            if starts is not None:
                r, jacobian = starts.left(r), starts.left(jacobian)
            last[key] = (r + shift, jacobian)
        return last[key]

    begin = np.clip(z, 1e-9, 1 - 1e-9)
    try:
        found = least_squares(
            lambda x: at(x)[0], begin, lambda x: at(x)[1], (0.0, 1.0), x_scale="jac", ftol=SAME, xtol=1e-8, gtol=1e-10,
            max_nfev=EVALUATIONS,
        )  # fmt: skip
    except (ValueError, np.linalg.LinAlgError):
        return None
    return found.x if np.all(np.isfinite(found.x)) and found.cost < 1e99 else None
