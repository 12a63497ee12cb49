"""Standard errors at an answer, from the exact Jacobian, sound when residuals are autocorrelated."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded
from scipy.sparse.csgraph import connected_components

from plantfit.problem.measure.long_run import (
    SHORT,
    at_most,
    degrees_of_freedom,
    first_correlation,
    most_memory,
    prewhitened_long_run,
    unbiased,
    widening,
)

EXACT = 1e-10  # of what a parameter does to the outputs: residuals below are rounding
ALIKE = 1e-11  # of the largest eigenvalue: others as near as this are equal but for rounding
TIED = 1e-6  # entry of a projector from which on two coordinates move together in a space
LEAST_DEGREES = 0.5  # of freedom of an output's residuals, at least
MANY = 100.0  # from which on Student's t is that of all samples together
LOST = 1e-13  # of the largest eigenvalue: what is less beside it is as much rounding as number
BOX_PRECISION = 12.0  # 1 / variance of a uniform variable over the unit cube's edge


@dataclass(frozen=True)
class Block:
    """Residuals of one output in one recording: rows of the Jacobian, and which error of the sensor each has, whole
    numbers (m,).

    Those of sample numbers where errors belong to times. Neighbours may be correlated, and equal numbers are one error.
    `scaled`: the user gave the scale of the output.
    """

    rows: slice
    index: np.ndarray
    output: str = ""
    scaled: bool = False


@dataclass(frozen=True)
class OutputErrors:
    """`larger`: what squared residuals of an output are multiplied by, for what the fit took from them; `least`: the
    mean square that its errors have at least; `degrees` of freedom that their size rests on."""

    larger: float
    least: float
    degrees: float

    def mean_square(self, residuals: np.ndarray) -> float:
        """Of errors whose residuals (k,) these are."""
        return max(float(np.mean(residuals**2)) * self.larger, self.least)


def known_variance(blocks: Sequence[Block], samples: int, coordinates: int) -> float:
    """The least variance of scaled residuals: 1 where all scales are known and `samples` are no more than
    `coordinates`, for residuals may be nothing then whatever the errors are; else 0."""
    return 1.0 if samples <= coordinates and blocks and all(b.scaled for b in blocks) else 0.0


def output_errors(
    j: np.ndarray, blocks: Sequence[Block], bread: np.ndarray, variance: float
) -> dict[str, OutputErrors]:
    """By output, from the derivatives (m, d) and the inverse (d, d) of J'J / `variance`, the mean square of all
    residuals.

    An output of n samples whose leverages sum to k has n - k degrees of freedom left, of the m - d of the whole problem
    (D. A. Belsley and others, Regression Diagnostics, 1980, section 2.1). Few samples with scales that the user gave
    have errors as large as those of all, each in its scale.
    """
    m, d = j.shape
    left, counts = dict.fromkeys((b.output for b in blocks), 0.0), dict.fromkeys((b.output for b in blocks), 0)
    if len(left) == 1:
        known = known_variance(blocks, m, d)
        return {
            o: OutputErrors(m / max(1, m - d), variance * known, np.inf if known else float(max(1, m - d)))
            for o in left
        }
    for block in blocks:
        rows = j[block.rows]
        on = np.flatnonzero(np.any(rows != 0.0, axis=0))
        rows = rows[:, on]
        counts[block.output] += len(rows)
        left[block.output] += len(rows) - float(np.sum((rows @ bread[np.ix_(on, on)]) * rows)) / variance
    scaled = {b.output for b in blocks if b.scaled and counts[b.output] <= d}
    return {
        o: OutputErrors(counts[o] / max(left[o], LEAST_DEGREES), variance, float(max(1, m - d)))
        if o in scaled
        else OutputErrors(counts[o] / max(left[o], LEAST_DEGREES), 0.0, max(left[o], LEAST_DEGREES))
        for o in left
    }


def errors_at(residuals: np.ndarray, j: np.ndarray, blocks: Sequence[Block]) -> dict[str, OutputErrors]:
    """As `output_errors`, from residuals (m,) and derivatives (m, d) alone."""
    variance = max(float(residuals @ residuals) / max(len(residuals) - np.linalg.matrix_rank(j), 1), 1e-300)
    return output_errors(j, blocks, variance * np.linalg.pinv(j.T @ j, hermitian=True), variance)


def own_student(
    j: np.ndarray, residuals: np.ndarray, blocks: Sequence[Block], bread: np.ndarray, variance: float, common: float
) -> np.ndarray:
    """How much longer (d,) than by the `common` degrees of freedom intervals are that rest on outputs of few samples,
    by Satterthwaite.

    Arguments as of `sandwich`.
    """
    errors = output_errors(j, blocks, bread, variance)
    if min(e.degrees for e in errors.values()) >= min(MANY, common):
        return np.ones(j.shape[1])
    shares = {o: np.zeros(j.shape[1]) for o in errors}
    for block in blocks:
        own = errors[block.output]
        shares[block.output] += np.sum((j[block.rows] @ bread / variance) ** 2, axis=0) * own.mean_square(
            residuals[block.rows]
        )
    total, squares = sum(shares.values()), sum(s**2 / errors[o].degrees for o, s in shares.items())
    degrees = np.minimum(np.divide(total**2, squares, out=np.full(j.shape[1], np.inf), where=squares > 0), common)
    return widening(degrees) / widening(np.array([common]))


def normal_matrix(jacobian: np.ndarray, blocks: list[Block]) -> np.ndarray:
    """J'J (d, d), block by block: the parameters of other recordings have columns of zeros there."""
    total = np.zeros((jacobian.shape[1],) * 2)
    for block in blocks:
        rows, columns = _nonzero(jacobian[block.rows])
        total[np.ix_(columns, columns)] += rows.T @ rows
    return total


def box_prior(hessian: np.ndarray) -> np.ndarray:
    """Precision (d, d) of the box along the principal directions of the hessian (d, d).

    Along a unit vector v the cube is 1 / max|v| long, and a uniform variable on that length has the variance
    1 / (12 max|v|^2). Twelve in every direction would let n parameters that move together hide a factor sqrt(n).

    Equal eigenvalues (those of directions that nothing shows, above all) span a space in which rounding chooses the
    directions: there max|v|^2 is the largest of any v in it, for each set of coordinates that the space ties together.
    """
    values, vectors = np.linalg.eigh(hessian)
    precision = np.zeros_like(hessian)
    for space in np.split(vectors, 1 + np.flatnonzero(np.diff(values) > ALIKE * max(values[-1], 0.0)), axis=1):
        onto = space @ space.T
        if space.shape[1] == 1:
            precision += BOX_PRECISION * np.max(np.abs(space)) ** 2 * onto
            continue
        count, labels = connected_components(np.abs(onto) > TIED, directed=False)
        largest = np.array([np.max(np.diag(onto)[labels == k]) for k in range(count)])
        precision += BOX_PRECISION * np.where(labels[:, None] == labels, largest[labels], 0.0) * onto
    return precision


def inverse_beside(hessian: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """The inverse (d, d) of a positive semidefinite `hessian` (d, d) plus a positive definite `prior` (d, d).

    Where data are exact, a direction that they leave open has rounding in the hessian that is more than the prior, and
    would look known. There the prior is made the unit, and what is rounding beside the largest direction is none.
    """
    if not _lost(hessian, prior):
        return np.linalg.inv(hessian + prior)
    root = np.linalg.inv(np.linalg.cholesky(prior))
    known, directions = np.linalg.eigh(root @ hessian @ root.T)
    known = np.where(known > len(known) * np.finfo(float).eps * known[-1], known, 0.0)
    columns = root.T @ directions
    return (columns / (1.0 + known)) @ columns.T


def _lost(hessian: np.ndarray, prior: np.ndarray) -> bool:
    """Whether the prior is rounding beside the hessian along some direction that this leaves open."""
    values = np.linalg.eigvalsh(hessian + prior)
    return bool(values[0] < LOST * values[-1])


def _nonzero(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m, d) without their columns of zeros, and the places of the columns kept."""
    columns = np.flatnonzero(np.any(rows != 0.0, axis=0))
    return rows[:, columns], columns


def effective_parameters(
    jacobian: np.ndarray, blocks: list[Block], smoothing: np.ndarray, variance: float
) -> np.ndarray:
    """How far the data and not a prior fix each coordinate (d,), 0 to 1: the diagonal of (J'J + S + v P)^-1 J'J.

    `smoothing` S (d, d) is what it adds to J'J, P the precision of the box, v the residuals' `variance`. The sum is the
    effective number of parameters (Wood, Generalized Additive Models, 2nd ed. 2017, section 5.4.2).
    """
    if jacobian.shape[1] == 0:
        return np.zeros(0)
    data = normal_matrix(jacobian, blocks)
    total = data + smoothing
    box = max(variance, rounding(data, len(jacobian))) * box_prior(total)
    return np.diag(inverse_beside(total, box) @ data).copy()


def rounding(data: np.ndarray, samples: int) -> float:
    """A residual variance that is rounding: outputs are exact to 1e-10 of what a parameter does to them; data is J'J
    (d, d)."""
    return max(EXACT**2 * float(np.max(np.diag(data), initial=0.0)) / max(samples, 1), 1e-200)


class Begins(NamedTuple):
    """What noise of measured values that states begin at does to the residuals, by standard deviations of that noise.

    `noise` (m, k) of values that the fit takes as they are, `estimated` (m, l) of those whose noise it estimates;
    `known` (l,) is the information, by one standard deviation, that a value has of itself beside the residuals: 0 where
    it is one of the fitted samples.
    """

    noise: np.ndarray
    estimated: np.ndarray
    known: np.ndarray

    def of(self, rows: slice) -> "Begins":
        """Of these residuals alone, and of the values that they feel."""
        noise, estimated = self.noise[rows], self.estimated[rows]
        felt = np.any(estimated != 0.0, axis=0)
        return Begins(noise[:, np.any(noise != 0.0, axis=0)], estimated[:, felt], self.known[felt])


def covariance(
    jacobian: np.ndarray,
    residuals: np.ndarray,
    blocks: list[Block],
    free: np.ndarray,
    smoothing: np.ndarray | None = None,
    robust: bool = True,
    begins: Begins | None = None,
    prior: np.ndarray | None = None,
) -> np.ndarray:
    """Covariance (d, d) of the cube coordinates by the sandwich estimator, with the box as prior, or one of precision
    `prior` (d,).

    The long-run covariance of the influences (J'J)^-1 J_t r_t with Bartlett weights (Newey and West,
    Econometrica 55 (1987) 703, eq. 5), prewhitened because slow residuals otherwise make intervals
    too short; no variance is less than residuals of one size and without memory in each block would give, or, where
    they are plainly of several sizes, less than their own may be (`not_below`). The uniform prior keeps flat directions
    finite (see `box_prior`): a standard error is at most that of the box, 0.29. `smoothing` (d, d) is what it adds to
    J'J; it is a prior as well, so that intervals allow for the bias that it makes (Wahba, J. R. Statist. Soc. B 45
    (1983) 133, section 2). Not `robust`, residuals are taken to be of one size and without memory (the classical
    covariance). `begins` tells what noise of measured values that states begin at does to the residuals
    (`first_values`). Coordinates not `free` (held at a bound) get zero rows and columns. One block at a time is worked
    on, so that the memory is that of one recording.
    """
    d = jacobian.shape[1]
    result = np.zeros((d, d))
    active = np.flatnonzero(free)
    if len(active) == 0:
        return result
    j = jacobian[:, active]
    degrees = max(1, len(residuals) - len(active))
    data = normal_matrix(j, blocks)
    least = max(rounding(data, len(residuals)), known_variance(blocks, len(residuals), len(active)))
    variance = max(float(residuals @ residuals) / degrees, least)
    hessian = data / variance
    smooth = np.zeros_like(hessian) if smoothing is None else smoothing[np.ix_(active, active)] / variance
    before = smooth + (box_prior(hessian + smooth) if prior is None else np.diag(prior[active]))
    bread = inverse_beside(hessian, before)
    spread = beside_starts(j, residuals, blocks, bread, before, variance, degrees, robust, begins) + begun(
        j, bread, variance, begins
    )
    if prior is not None:
        result[np.ix_(active, active)] = 0.5 * (spread + spread.T)
        return result
    inside = np.sqrt(np.minimum(1.0, 1.0 / (BOX_PRECISION * np.maximum(np.diag(spread), 1e-300))))
    result[np.ix_(active, active)] = spread * inside[:, None] * inside[None, :]
    return 0.5 * (result + result.T)


def begun(j: np.ndarray, bread: np.ndarray, variance: float, begins: Begins | None) -> np.ndarray:
    """Covariance (d, d) that noise in measured initial values adds which the fit has not estimated."""
    if begins is None or not begins.noise.shape[1]:
        return np.zeros_like(bread)
    moved = bread @ (j.T @ begins.noise) / variance
    return moved @ moved.T


def beside_starts(
    j: np.ndarray,
    residuals: np.ndarray,
    blocks: list[Block],
    bread: np.ndarray,
    prior: np.ndarray,
    variance: float,
    degrees: int,
    robust: bool,
    begins: Begins | None,
) -> np.ndarray:
    """As `sandwich`, with starts that were estimated beside the parameters, if any: those are part of the estimates,
    and not told."""
    if begins is None or not begins.estimated.shape[1]:
        return sandwich(j, residuals, blocks, bread, prior, variance, degrees, robust)
    d, columns = j.shape[1], begins.estimated
    cross, own = j.T @ columns / variance, columns.T @ columns / variance + np.diag(begins.known)
    moved = bread @ cross
    left = own - cross.T @ moved
    corner = np.linalg.inv(0.5 * (left + left.T))
    whole = np.block([[bread + moved @ corner @ moved.T, -moved @ corner], [-corner @ moved.T, corner]])
    before = np.zeros_like(whole)
    before[:d, :d], before[d:, d:] = prior, np.diag(begins.known)
    return sandwich(np.hstack([j, columns]), residuals, blocks, whole, before, variance, degrees, robust)[:d, :d]


def sandwich(
    j: np.ndarray,
    residuals: np.ndarray,
    blocks: list[Block],
    bread: np.ndarray,
    prior: np.ndarray,
    variance: float,
    degrees: int,
    robust: bool,
) -> np.ndarray:
    """Covariance (d, d) of the estimates: `bread` (d, d), the inverse of J'J / variance + `prior`, around what the
    residuals show.

    Not `robust`, all residuals of an output are of one size and without memory, which is the classical covariance;
    where the user gave their scales those of all outputs are.
    """
    spread, errors = bread @ prior @ bread, output_errors(j, blocks, bread, variance)
    if not robust:
        for block in blocks:
            # by what residuals do to estimates: bread J'J bread would lose what parallel columns cancel
            influences = j[block.rows] @ bread
            pooled = block.scaled or len(errors) == 1
            size = 1.0 if pooled else errors[block.output].mean_square(residuals[block.rows]) / variance
            spread = spread + influences.T @ influences * (size / variance)
        return spread
    alike = spread.copy()
    for block in blocks:
        # what every residual does to every estimate: in these series nearly parallel columns of the
        # Jacobian have cancelled already, so that each may be filtered by its own memory
        rows, columns = _nonzero(j[block.rows])
        touched = np.flatnonzero(np.any(bread[columns] != 0.0, axis=0))
        if not len(touched):  # nothing that is fitted acts on this output
            continue
        by_residual, own = rows @ bread[np.ix_(columns, touched)] / variance, residuals[block.rows]
        times = bool(np.all(np.diff(block.index) > 0))  # else errors belong to places of a sensor, and not to times
        plain = with_memory(by_residual, own, j.shape[1]) if times else by_residual.T @ by_residual
        plain *= errors[block.output].mean_square(own)
        found = prewhitened_long_run(by_residual * own[:, None], block.index, j.shape[1]) * errors[block.output].larger
        if errors[block.output].least:  # few samples: what they show by chance is no less than what their scale says
            wider = np.sqrt(np.maximum(1.0, np.diag(found) / np.maximum(np.diag(plain), 1e-300)))
            found = plain * np.outer(wider, wider)
        spread[np.ix_(touched, touched)] += found
        alike[np.ix_(touched, touched)] += plain
    least = not_below(
        np.diag(alike), np.diag(spread), lambda: _degrees(j, residuals, blocks, bread, variance, errors), len(residuals)
    )
    wider = np.sqrt(np.maximum(1.0, least / np.maximum(np.diag(spread), 1e-300)))
    return spread * np.outer(wider, wider)


def with_memory(influences: np.ndarray, residuals: np.ndarray, fitted: int) -> np.ndarray:
    """Covariance (d, d) that influences (m, d) make of errors of variance 1 with the first correlation of the residuals
    (m,), an AR(1)'s.

    Where few samples decide, as of a start, their own residuals cannot show by how much neighbours add up. A
    correlation that chance explains counts as none.
    """
    n, plain = len(residuals), influences.T @ influences
    r = float(unbiased(first_correlation(residuals[:, None]), n, fitted)[0])
    if n < SHORT or r <= 2.0 / np.sqrt(n):
        return plain
    memory = min(r, most_memory(n, fitted))
    # as lfilter, whose room is slow to import
    kept = solve_banded((1, 0), np.vstack([np.ones(n), np.full(n, -memory)]), influences)
    cross = influences.T @ kept
    return cross + cross.T - plain


def not_below(alike: np.ndarray, own: np.ndarray, degrees: Callable[[], np.ndarray], samples: int) -> np.ndarray:
    """The least variances (d,) to count with, from those of residuals of one size (d,) and those that the residuals
    themselves give (d,).

    Few samples that fix an estimate follow the noise, and their residuals are too small (MacKinnon and White, J.
    Econometrics 29 (1985)
    305): where they give less than residuals of one size would, chance may be why. Many that do so have less noise than
        the others, as
    a motor's speed by pulses has where it is slow: then it is the most that their own variance allows with its
    `degrees` of freedom.
    """
    doubted = alike > at_most(np.array([float(samples)]))[0] * own  # at most so many degrees: else it is `alike` anyway
    return np.where(doubted, np.minimum(alike, at_most(degrees()) * own), alike) if np.any(doubted) else alike


def _degrees(
    j: np.ndarray,
    residuals: np.ndarray,
    blocks: list[Block],
    bread: np.ndarray,
    variance: float,
    errors: Mapping[str, OutputErrors],
) -> np.ndarray:
    """Degrees of freedom (d,) of the variances that the residuals give: those of the blocks' sum, by Satterthwaite."""
    totals, squares = np.zeros(j.shape[1]), np.zeros(j.shape[1])
    for block in blocks:
        rows, columns = _nonzero(j[block.rows])
        touched = np.flatnonzero(np.any(bread[columns] != 0.0, axis=0))
        if not len(touched):
            continue
        by_residual, own = rows @ bread[np.ix_(columns, touched)] / variance, residuals[block.rows]
        shares = by_residual**2 * errors[block.output].mean_square(own)
        total = np.sum(shares, axis=0)
        totals[touched] += total
        squares[touched] += total**2 / degrees_of_freedom(by_residual * own[:, None], shares, block.index)
    return np.divide(totals**2, squares, out=np.full(len(totals), np.inf), where=squares > 0)
