"""What errors that a whole recording shares do to the parameters: by linear propagation, and by Monte Carlo."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # scipy.special is loaded at its first use

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.trust.finish.refit import refit
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.intervals.covariance import box_prior, covariance, known_variance, normal_matrix
from plantfit.trust.intervals.first_values import first_value_effects
from plantfit.trust.intervals.linearised import EDGE, linearise, residual_blocks
from plantfit.trust.intervals.ranges import linear_problem, plain_space
from plantfit.trust.intervals.robust_or_classical import robust_errors
from plantfit.trust.stated_errors.shared_error import SharedError as SharedError
from plantfit.trust.stated_errors.uncertainty_budget import MANY

FINE = 1e-9  # relative decrease of the cost that ends a refit here, where small moves count
REACH = 6.0  # standard uncertainties that a held constant is freed by on either side


@dataclass(frozen=True)
class ParameterUncertainty:
    """Parameters (d,) in their units: `values`, `random` standard errors from the residuals, `systematic` (d,) standard
    uncertainties by source, `combined`, its `degrees_of_freedom` (inf: many), `low` and `high`; held parameters have
    zeros. One that is pressed on a bound is not known to first order: its parts and its interval are NaN.

    `draws` (n, d): parameters of the refits of the Monte Carlo, else None; they carry the systematic and the random
    part.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: np.ndarray
    random: np.ndarray
    systematic: Mapping[str, np.ndarray]
    combined: np.ndarray
    low: np.ndarray
    high: np.ndarray
    degrees_of_freedom: np.ndarray
    draws: np.ndarray | None = None

    @property
    def shared(self) -> np.ndarray:
        """Standard uncertainty (d,) by all sources together, without the noise."""
        return np.sqrt(sum((s**2 for s in self.systematic.values()), np.zeros(len(self.names))))

    def _of(self, places: Sequence[int]) -> "ParameterUncertainty":
        """The same of some of the parameters."""
        at = list(places)
        return ParameterUncertainty(
            tuple(self.names[i] for i in at), tuple(self.units[i] for i in at), self.values[at], self.random[at],
            {n: s[at] for n, s in self.systematic.items()}, self.combined[at], self.low[at], self.high[at],
            self.degrees_of_freedom[at], None if self.draws is None else self.draws[:, at],
        )  # fmt: skip


def propagate(
    problem: Problem, answer: Any, errors: Sequence[SharedError], k: float | None = None
) -> ParameterUncertainty:
    """Standard uncertainties to first order, with intervals of `k` combined ones around the values, inside the bounds.

    `answer` is a cube point (d,) or what `fit` returns. An error e moves the least-squares answer by

        dp/de = -(J'J)^-1 J' dr/de                                                                   (1)

    (the implicit function theorem at the minimum, without second derivatives of the residuals), J by the exact
    derivatives, dr/de by central differences over one standard uncertainty. Variances of independent errors and of the
    noise add (JCGM 100, eq. 10). Without `k` the intervals hold 95 %, by Student's t where sources have few degrees of
    freedom (JCGM 100, G.4.1). Raises SpaceError for a "constant" that is no single number of the problem, and
    RecordingError for an unknown signal.
    """
    work, z = _with_constants(problem, answer, errors)
    found = _propagate(work, z, errors, k)
    return found._of([work.space.names.index(n) for n in problem.space.names])


def _propagate(
    problem: Problem, z: np.ndarray, errors: Sequence[SharedError], k: float | None = None
) -> ParameterUncertainty:
    free = _free(problem, errors)
    local = linearise(problem, z)
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    slope = problem.space.slopes(z)
    pressed = free & np.array([b is not None for b in local.at_bound])
    at = np.flatnonzero(free & ~pressed)
    solve, noise = _solver(problem, z, residuals, jacobian, at)
    squares: dict[str, np.ndarray] = {}
    few = np.zeros(len(z))  # the sum in the formula of Welch and Satterthwaite
    for error in errors:
        own = np.zeros(len(z))
        own[at] = np.sum((solve @ _by_error(problem, z, jacobian, slope, error)) ** 2, axis=1)
        own *= (slope * error.source.standard) ** 2
        few += own**2 / error.source.degrees_of_freedom
        squares[error.source.name] = squares.get(error.source.name, 0.0) + own
    for own in squares.values():
        own[pressed] = np.nan
    random = np.where(pressed, np.nan, 0.0)
    random[at] = np.sqrt(np.maximum(np.diag(noise), 0.0)) * slope[at]
    systematic = {n: np.sqrt(s) for n, s in squares.items()}
    combined = np.sqrt(random**2 + sum(squares.values(), np.zeros(len(z))))
    degrees = np.divide(combined**4, few, out=np.full(len(z), np.inf), where=few > 0)
    names, units, values = _named(problem, z)
    factor = coverage_factors(degrees) if k is None else k
    low, high = (
        np.maximum(values - factor * combined, problem.space.lower),
        np.minimum(values + factor * combined, problem.space.upper),
    )
    return ParameterUncertainty(names, units, values, random, systematic, combined, low, high, degrees)


def coverage_factors(degrees: np.ndarray) -> np.ndarray:
    """Of 95 % for effective degrees of freedom, cut to whole numbers (JCGM 100, G.4.1); 1.96 for many."""
    return np.where(
        degrees > MANY, 1.96, scipy.special.stdtrit(np.maximum(1.0, np.floor(np.minimum(degrees, MANY))), 0.975)
    )


def propagate_by_monte_carlo(
    problem: Problem, answer: Any, errors: Sequence[SharedError], draws: int = 200, seed: int = 0, level: float = 0.95
) -> ParameterUncertainty:
    """As `propagate`, but each of `draws` takes errors from their distributions, corrects the recordings and fits them
    anew.

    The spread that the noise leaves is added to each refit by a normal draw with the covariance of the answer (JCGM
    101, 5.9 and
    6.4); `low` and `high` are percentiles, the systematic parts those of `propagate`. Refits begin at the answer.
    """
    work, z = _with_constants(problem, answer, errors)
    keep = [work.space.names.index(n) for n in problem.space.names]
    linear, free = _propagate(work, z, errors), _free(work, errors)
    inside = free & (z > EDGE) & (z < 1 - EDGE)
    rng = np.random.default_rng(seed)
    drawn = [e.source.draw(rng, draws * _numbers(work, e)).reshape(draws, -1) for e in errors]
    residuals, jacobian = work.unsmoothed.residuals_and_jacobian(z)
    at = np.flatnonzero(inside)
    noise = _solver(work, z, residuals, jacobian, at)[1]
    shaken = np.zeros((draws, len(z)))
    shaken[:, at] = rng.multivariate_normal(np.zeros(len(at)), noise, draws, method="eigh")
    found = np.empty((draws, len(z)))
    slope = work.space.slopes(z)
    for i in range(draws):
        recordings = {n: e.recording for n, e in work.experiments.items()}
        start = z.copy()
        for error, values in zip(errors, drawn, strict=True):
            recordings = _corrected(recordings, error, values[i])
            if error.constant is not None:
                place = work.space.names.index(error.constant)
                start[place] += values[i, 0] / slope[place]
        point, _ = refit(work.with_recordings(recordings), start, free, FINE)
        found[i] = np.asarray(work.space.physical(np.clip(point + shaken[i], 0.0, 1.0)))
    low, high = np.quantile(found, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    held = ~free
    low[held] = high[held] = linear.values[held]
    spread = np.where(held, 0.0, np.std(found, axis=0, ddof=1))
    low, high, spread = (np.where(np.isnan(linear.combined), np.nan, v) for v in (low, high, spread))
    return ParameterUncertainty(
        linear.names,
        linear.units,
        linear.values,
        linear.random,
        linear.systematic,
        spread,
        low,
        high,
        linear.degrees_of_freedom,
        found,
    )._of(keep)


def check_errors(problem: Problem, errors: Sequence[SharedError]) -> None:
    """Raises SpaceError for a "constant" that is no single number of the problem, RecordingError for unknown signals
    and recordings."""
    known = problem.space.parameters
    for error in errors:
        name, touched = error.constant, error.touches(tuple(problem.experiments))
        if name is None:
            for recording in touched if error.kind != "clock" else ():
                for signal in error.names:
                    problem.experiments[recording].recording[signal]
        elif name not in problem.space.names and (
            name not in known or known[name].value is None or known[name].shape or known[name].tied is not None
        ):
            raise SpaceError(
                f"The constant {name!r} is no single number of the problem that is held at "
                "a value or free; give a parameter of that name a value, or bounds around "
                f"it. Single numbers are {[n for n, p in known.items() if not p.shape]}."
            )


def _with_constants(problem: Problem, answer: Any, errors: Sequence[SharedError]) -> tuple[Problem, np.ndarray]:
    """The problem with a coordinate for every uncertain constant that it holds, and the cube point (d,) of the
    answer there."""
    check_errors(problem, errors)
    problem = as_known(problem)
    z = np.array(getattr(getattr(answer, "best", None), "x", answer), dtype=float)
    bounds, held, known = {}, {}, problem.space.parameters
    for name in dict.fromkeys(
        e.constant for e in errors if e.constant is not None and e.constant not in problem.space.names
    ):
        held[name] = value = float(known[name].value or 0.0)
        stated = sum(e.source.standard for e in errors if e.constant == name)
        reach = max(REACH * stated, 1e-9 * abs(value), 1e-12)
        # a mass or a delay stays one
        bounds[name] = (max(value - reach, 0.0) if value > 0 else value - reach, value + reach)
    if not bounds:
        return problem, z
    work = problem.freed(bounds)
    values = dict(zip(problem.space.names, np.asarray(problem.space.physical(z)).tolist(), strict=True))
    return work, work.space.cube(work.space.vector({**values, **held}))


def _free(problem: Problem, errors: Sequence[SharedError]) -> np.ndarray:
    """Which coordinates (d,) the fit had free."""
    constants = {e.constant for e in errors}
    return np.array([n not in constants for n in problem.space.names], dtype=bool)


def _solver(
    problem: Problem, z: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What takes residuals to moves of the coordinates `at` (q, m), and the covariance (q, q) that the noise gives
    them."""
    blocks, j = residual_blocks(problem), jacobian[:, at]
    least = max(known_variance(blocks, len(residuals), len(at)), np.finfo(float).tiny)
    variance = max(float(residuals @ residuals) / max(1, len(residuals) - len(at)), least)
    hessian = normal_matrix(j, blocks) / variance
    smoothing = None if problem.smoothing is None else problem.smoothing.matrix[np.ix_(at, at)]
    if smoothing is not None:
        hessian = hessian + smoothing / variance
    plain, begins = np.linalg.inv(hessian + box_prior(hessian)), first_value_effects(problem, z, blocks)
    robust = robust_errors(problem, residuals, blocks)
    if plain_space(problem):  # as `linearise` has it
        linear = linear_problem(problem, z, residuals, jacobian, blocks, robust, at, begins)
        scale = linear.size / problem.space.slopes(z)[at]
        return plain @ j.T / variance, linear.spread * scale[:, None] * scale[None, :]
    return plain @ j.T / variance, covariance(j, residuals, blocks, np.ones(len(at), bool), smoothing, robust, begins)


def _by_error(
    problem: Problem, z: np.ndarray, jacobian: np.ndarray, slope: np.ndarray, error: SharedError
) -> np.ndarray:
    """Derivatives (m, r) of the residuals by the numbers of a shared error, the parameters held."""
    if error.constant is not None:
        place = problem.space.names.index(error.constant)
        return (jacobian[:, place] / slope[place])[:, None]
    step = error.source.standard
    if step == 0.0:
        return np.zeros((len(jacobian), 1))
    ends, before = [], {n: e.recording for n, e in problem.experiments.items()}
    for sign in (1.0, -1.0):
        moved = _corrected(before, error, np.full(_numbers(problem, error), sign * step))
        ends.append(np.asarray(problem.with_recordings(moved).unsmoothed.residuals(z)))
    together = (ends[0] - ends[1]) / (2.0 * step)
    return np.where(_owners(problem, error), together[:, None], 0.0) if error.per_recording else together[:, None]


def _owners(problem: Problem, error: SharedError) -> np.ndarray:
    """Which residuals (m, r) belong to each recording that has the error."""
    counts = {n: sum(len(problem.data["index"][n][o]) for o in problem.outputs) for n in problem.data["drive"]}
    owner = np.repeat(list(counts), list(counts.values()))
    return owner[:, None] == np.array(error.touches(tuple(problem.experiments)))[None, :]


def _numbers(problem: Problem, error: SharedError) -> int:
    """How many numbers an error is: one, or one for each recording that has it."""
    return len(error.touches(tuple(problem.experiments))) if error.per_recording else 1


def _corrected(recordings: Mapping[str, Recording], error: SharedError, values: np.ndarray) -> dict[str, Recording]:
    """The recordings without an error of these sizes (r,)."""
    names = error.touches(tuple(recordings))
    sizes = dict(zip(names, np.broadcast_to(values, len(names)).tolist(), strict=True))
    return {n: error.corrected(r, sizes[n]) if n in sizes else r for n, r in recordings.items()}


def _named(problem: Problem, z: np.ndarray) -> tuple[tuple[str, ...], tuple[str | None, ...], np.ndarray]:
    return problem.space.names, tuple(c.unit for c in problem.space.coordinates), np.asarray(problem.space.physical(z))
