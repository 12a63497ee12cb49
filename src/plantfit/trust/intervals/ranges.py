"""Between which values a parameter can lie when everything that costs little more than the answer is allowed."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.triangle import triangle
from plantfit.problem.measure.long_run import first_correlation, most_memory, unbiased
from plantfit.problem.problem import Problem
from plantfit.trust.finish.unknown_noise import LEAST_FREE
from plantfit.trust.intervals.at_limits import limit_factors
from plantfit.trust.intervals.covariance import (
    Begins,
    Block,
    begun,
    beside_starts,
    known_variance,
    own_student,
    rounding,
)

FAR = 1e4  # sizes of a value that nothing moves further than
OPEN = 1e3  # sizes from which on a linearised end means nothing
MOST = 60  # coordinates up to which ranges are made; their number enters to the fourth power
LEVEL = 0.95
SLOW = 0.99  # correlation from which on intervals are too short
EDGE = 1e-6  # of the cube: closer to a bound counts as on it
MANY = 1e6  # degrees of freedom of a variance that is known
HALVINGS = 40
BY_CHANCE = 1.5  # standard errors beyond a bound, up to which noise may take a value there
LOOSE = 0.25  # sizes, the standard error of a direction from which on what cancels along it is worked out apart


@dataclass(frozen=True)
class Linear:
    """The linearised problem in units of `size` (d,): parameters x = (p - values) / size, limits included.

    `rows` (k, d) and `rest` (k,): sum of squares |rows x + rest|^2 over the residual variance; `spread` (d, d) the
    covariance of x by the sandwich with no prior but that nothing moves further than `FAR`; `threshold` (d,) what the
    sum may grow by, by the `quantile` of Student's t with so many `degrees` of freedom. `samples`: how many independent
    ones the residuals are worth; not `sound` where these are too few for intervals that hold. `begun` (d,): how many
    times as large standard errors are because states begin at measured values whose noise is not estimated. Where some
    direction is open, rows of `turn` (d, d) are principal directions, and `turned` (d, d) is the covariance along them.
    """

    values: np.ndarray
    size: np.ndarray
    least: np.ndarray
    most: np.ndarray
    rows: np.ndarray
    rest: np.ndarray
    spread: np.ndarray
    threshold: np.ndarray
    quantile: float
    degrees: float
    variance: float
    samples: float
    sound: bool
    begun: np.ndarray
    turn: np.ndarray | None = None
    turned: np.ndarray | None = None

    def variance_of(self, weights: np.ndarray) -> float:
        """Of the sum of x with these weights (d,).

        Along an open direction entries of `spread` are a hundred million; what is known to a ten-thousandth would be
        rounding in them.
        """
        if self.turn is None or self.turned is None:
            return max(float(weights @ self.spread @ weights), 0.0)
        along = self.turn @ weights
        return max(float(along @ self.turned @ along), 0.0)

    @property
    def standard_error(self) -> np.ndarray:
        """Of every value (d,) in its unit, all others free; beyond `OPEN` sizes it means nothing."""
        return np.sqrt(np.diag(self.spread)) * self.size


@dataclass
class Range:
    """From `low` to `high` in the unit of a parameter, infinite where the data set no end.

    `points` are cube points (d,) of about the answer's cost that were met at the ends.
    """

    low: float
    high: float
    points: list[np.ndarray] = field(default_factory=list)


def effective_samples(residuals: np.ndarray, blocks: Sequence[Block], fitted: int) -> tuple[float, float]:
    """How many independent samples the residuals (m,) are worth, and their largest correlation from sample to sample.

    n (1 - r) / (1 + r) in each block, as for the mean of an AR(1) (Bartlett, J. R. Statist. Soc. 98 (1935) 536).
    """
    total, worst = 0.0, 0.0
    for block in blocks:
        own = residuals[block.rows]
        n = max(len(own), 1)
        r = float(np.clip(unbiased(first_correlation(own[:, None]), n, fitted)[0], 0.0, most_memory(n, fitted)))
        total, worst = total + len(own) * (1.0 - r) / (1.0 + r), max(worst, r if len(own) >= 10 else 0.0)
    return total, worst


def degrees_left(
    residuals: np.ndarray, blocks: Sequence[Block], fitted: int, robust: bool
) -> tuple[float, float, float]:
    """How many independent samples the residuals (m,) are worth where `fitted` parameters were, their largest
    correlation from sample to sample, and the degrees of freedom of Student's t for intervals."""
    samples, memory = effective_samples(residuals, blocks, fitted) if robust else (float(len(residuals)), 0.0)
    if known_variance(blocks, len(residuals), fitted):
        return samples, memory, MANY
    degrees = samples - fitted
    if degrees > 0 and memory > 2.0 / np.sqrt(len(residuals)):
        # an estimated correlation r makes sums of an AR(1) uncertain as 4 (1 + r) / (n (1 - r)) of their variance, by
        # its own (1 - r^2) / n
        degrees = 1.0 / (1.0 / degrees + 2.0 / samples)
    return samples, memory, max(1.0, degrees)


def plain_space(problem: Problem) -> bool:
    """Whether ranges are made: no tables, no smoothing, and at most 60 coordinates."""
    space = problem.space
    return problem.smoothing is None and space.dimension <= MOST and not any(c.index for c in space.coordinates)


def linear_problem(
    problem: Problem,
    z: np.ndarray,
    residuals: np.ndarray,
    jacobian: np.ndarray,
    blocks: list[Block],
    robust: bool,
    places: np.ndarray | None = None,
    begins: Begins | None = None,
) -> Linear:
    """The problem at the cube point z (d,), with residuals (m,) and their derivatives (m, d) there.

    With `places` (q,) of these coordinates alone, the others held. `begins` as in `covariance`.
    """
    space, at = problem.space, np.arange(len(z)) if places is None else np.asarray(places, dtype=int)
    coordinates = [space.coordinates[i] for i in at]
    values = np.asarray(space.physical(z))[at]
    width, typical = (space.upper - space.lower)[at], np.array([c.typical for c in coordinates])
    by_value = jacobian[:, at] / space.slopes(z)[at]
    norms, free = np.linalg.norm(by_value, axis=0), max(1, len(residuals) - len(at))
    known = known_variance(blocks, len(residuals), len(at))
    # how far it is known if all others are
    alone = np.sqrt(max(float(residuals @ residuals) / free, known)) / np.maximum(norms, 1e-300)
    size = np.maximum(np.maximum(np.abs(values), typical), np.maximum(np.minimum(alone, width), 1e-12 * width))
    j = by_value * size
    variance = max(float(residuals @ residuals) / free, rounding(np.diag(np.sum(j**2, axis=0)), len(residuals)), known)
    small = triangle(j, residuals) / np.sqrt(variance)
    rows = np.vstack([small[:, :-1], np.eye(len(at)) / FAR])
    rest = np.concatenate([small[:, -1], np.zeros(len(at))])
    _, singular, right = np.linalg.svd(rows, full_matrices=False)
    bread = (right.T / singular**2) @ right
    prior = np.eye(len(at)) / FAR**2
    # along principal directions: by the parameters, of which open directions make `bread` large, it would be rounding
    along = np.diag(1.0 / singular**2)
    turned = begun(j @ right.T, along, variance, begins)
    own = beside_starts(j, residuals, blocks, bread, prior, variance, free, robust, begins)
    spread = own + right.T @ turned @ right
    loose = bool(len(at)) and float(singular[-1]) < 1.0 / LOOSE
    if loose:
        turned = turned + beside_starts(j @ right.T, residuals, blocks, along, prior, variance, free, robust, begins)
    samples, memory, degrees = degrees_left(residuals, blocks, len(at), robust)
    sound = bool(not robust or known or (memory <= SLOW and samples - len(at) >= LEAST_FREE))
    quantile = float(stdtrit(degrees, 0.5 + LEVEL / 2))
    inflation = np.maximum(1e-6, np.diag(spread) / np.maximum(np.diag(bread), 1e-300))
    limits = np.array([c.limits for c in coordinates]).reshape(-1, 2)
    least, most = ((ends - values) / size for ends in limits.T)
    least, most = np.minimum(least, 0.0), np.maximum(most, 0.0)
    longer = own_student(j, residuals, blocks, bread, variance, samples - len(at))
    threshold = (quantile * longer) ** 2 * inflation * limit_factors(spread, least, most, quantile, OPEN)
    return Linear(
        values, size, least, most, rows, rest, spread, threshold, quantile, degrees, variance,
        samples, sound, np.sqrt(np.diag(spread) / np.maximum(np.diag(own), 1e-300)), right if loose else None,
        turned if loose else None,
    )  # fmt: skip


def linear_end(linear: Linear, i: int, sign: float, held: Sequence[int] = ()) -> tuple[float, np.ndarray]:
    """How far x_i can go to one side by the linearised problem, all inside their limits, and the point x (d,) there.

    Infinite where the sum of squares does not grow to the threshold; parameters `held` stay at the answer. The growth
    is convex along x_i with the others at their best, so that its last crossing is the end.
    """
    limit = linear.most[i] if sign > 0 else -linear.least[i]
    others = np.array([k for k in range(len(linear.values)) if k != i and k not in held], dtype=int)
    columns = linear.rows[:, others]
    base = float(linear.rest @ linear.rest)
    shadow = (
        linear.rows[:, i] - columns @ np.linalg.lstsq(columns, linear.rows[:, i])[0]
        if len(others)
        else linear.rows[:, i]
    )
    curvature = max(float(shadow @ shadow), 1e-300)
    norms = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    low, high = linear.least[others] * norms - 1e-12, linear.most[others] * norms + 1e-12

    def grown(step: float) -> tuple[float, np.ndarray]:
        moved = linear.rest + sign * step * linear.rows[:, i]
        x = np.zeros(len(linear.values))
        x[i] = sign * step
        if len(others):
            free = np.linalg.lstsq(columns / norms, -moved)[0]
            if np.any(free < low) or np.any(free > high):
                free = lsq_linear(columns / norms, -moved, (low, high), method="bvls").x
            x[others] = free / norms
        left = linear.rows @ x + linear.rest
        return float(left @ left) - base, x

    top = linear.threshold[i]
    inside, step = 0.0, float(np.sqrt(top / curvature))
    step = min(step, limit) if limit > 0 else 0.0
    at = np.zeros(len(linear.values))
    if step == 0.0:
        return 0.0, at
    beyond = None
    for k in range(HALVINGS):
        growth, x = grown(step)
        if growth <= top:
            inside, at = step, x
            if beyond is None:
                if step >= limit:
                    return limit, at
                if step > OPEN:
                    return np.inf if not np.isfinite(limit) else limit, at
                step = (
                    min(4.0 * step, limit) if growth < 0.25 * top else min(step * np.sqrt(1.05 * top / growth), limit)
                )
                continue
        else:
            beyond = step
        if beyond is not None:
            if beyond - inside <= 1e-3 * beyond:
                break
            # halved where it is no parabola
            guess = step * np.sqrt(top / growth) if growth > 0 and k % 2 else 0.5 * (inside + beyond)
            step = float(np.clip(guess, inside + 0.05 * (beyond - inside), beyond - 0.05 * (beyond - inside)))
    return inside, at


def pulled_beyond(linear: Linear, i: int, sign: float) -> float:
    """The share of the sum of squares that x_i would explain to one side beyond where it stands, the others inside
    their limits, by the linearised problem; 0 where noise may take it there.

    What a model lacks makes errors as large as the step beyond, so that these alone would hardly ever tell.
    """
    norms = np.maximum(np.linalg.norm(linear.rows, axis=0), 1e-300)
    low, high = linear.least * norms - 1e-12, linear.most * norms + 1e-12
    sums = []
    for reach in (0.0, np.inf):
        low[i], high[i] = -1e-12 - reach, 1e-12 + reach
        found = lsq_linear(linear.rows / norms, -linear.rest, (low, high), method="bvls")
        sums.append(2.0 * float(found.cost))
    step = sign * float(found.x[i]) / float(norms[i])
    if step < BY_CHANCE * float(np.sqrt(max(linear.spread[i, i], 1e-300))):
        return 0.0
    return max(0.0, 1.0 - sums[1] / max(sums[0], 1e-300))


def linear_range(linear: Linear, i: int, held: Sequence[int] = ()) -> Range:
    """The range of one value by the linearised problem."""
    ends = [linear.values[i] + sign * linear_end(linear, i, sign, held)[0] * linear.size[i] for sign in (-1.0, 1.0)]
    return Range(*ends)
