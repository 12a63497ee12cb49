"""What errors that a whole recording shares do to the parameters: by linear propagation, and by Monte Carlo."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.covariance import box_prior, covariance, normal_matrix
from plantfit.trust.local import EDGE, linearise, residual_blocks
from plantfit.trust.refit import refit
from plantfit.trust.uncertainty_budget import Source

import jax
import jax.numpy as jnp

FINE = 1e-9  # relative decrease of the cost that ends a refit here, where small moves count


@dataclass(frozen=True)
class SharedError:
    """An error that is one number e for all samples of all recordings.

    `kind` tells what it does: "offset" adds e to the signal `of`; "gain" multiplies the signal by 1 + e; "full scale" adds
    e y/span; "zero" adds e (1 - y/span); "clock" makes times 1 + e as long; "constant" adds e to the parameter `of`, which is one
    number for all recordings and free in the problem but was held in the fit.
    """

    source: Source
    kind: Literal["offset", "gain", "zero", "full scale", "clock", "constant"]
    of: str = ""
    span: float = 1.0

    def corrected(self, recording: Recording, error: float) -> Recording:
        """The recording without an error of this size."""
        if self.kind == "constant":
            return recording
        if self.kind == "clock":
            first = recording.t[0]
            return Recording(first + (recording.t - first) / (1.0 + error), recording.signals, recording.name, recording.log)
        y = recording[self.of]
        if self.kind == "offset":
            y = y - error
        elif self.kind == "gain":
            y = y / (1.0 + error)
        elif self.kind == "full scale":
            y = y / (1.0 + error / self.span)
        else:
            y = (y - error) / (1.0 - error / self.span)
        return Recording(
            recording.t, {**recording.signals, self.of: Signal(y, recording.signals[self.of].unit)}, recording.name, recording.log
        )


@dataclass(frozen=True)
class ParameterUncertainty:
    """Parameters (d,) in their units: `values`, `random` standard errors from the residuals, `systematic` (d,) standard
    uncertainties by source, `combined`, `low` and `high`; held parameters have zeros.

    `draws` (n, d): parameters of the refits of the Monte Carlo, else None; they carry the systematic and the random part.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: np.ndarray
    random: np.ndarray
    systematic: Mapping[str, np.ndarray]
    combined: np.ndarray
    low: np.ndarray
    high: np.ndarray
    draws: np.ndarray | None = None


def propagate(problem: Problem, answer: Any, errors: Sequence[SharedError], k: float = 1.96) -> ParameterUncertainty:
    """Standard uncertainties to first order, with intervals of `k` combined ones around the values, inside the bounds.

    `answer` is a cube point (d,) or what `fit` returns. An error e moves the least-squares answer by

        dp/de = -(J'J)^-1 J' dr/de                                                                   (1)

    (the implicit function theorem at the minimum, without second derivatives of the residuals), J by the exact derivatives, dr/de
    by central differences over one standard uncertainty. Variances of independent errors and of the noise add (JCGM 100, eq. 10).
    Raises SpaceError for a "constant" that is no free parameter.
    """
    z, free = _start(problem, answer, errors)
    local = linearise(problem, z)
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    slope = _slope(problem, z)
    at = np.flatnonzero(free & np.array([b is None for b in local.at_bound]))
    solve, noise = _solver(problem, residuals, jacobian, at)
    systematic = {}
    for error in errors:
        moved = np.zeros(len(z))
        moved[at] = -solve @ _by_error(problem, z, jacobian, slope, error)
        systematic[error.source.name] = np.abs(moved * slope) * error.source.standard
    random = np.zeros(len(z))
    random[at] = np.sqrt(np.maximum(np.diag(noise), 0.0)) * slope[at]
    combined = np.sqrt(random**2 + sum((s**2 for s in systematic.values()), np.zeros(len(z))))
    names, units, values = _named(problem, z)
    low, high = np.maximum(values - k * combined, problem.space.lower), np.minimum(values + k * combined, problem.space.upper)
    return ParameterUncertainty(names, units, values, random, systematic, combined, low, high)


def propagate_by_monte_carlo(
    problem: Problem, answer: Any, errors: Sequence[SharedError], draws: int = 200, seed: int = 0, level: float = 0.95
) -> ParameterUncertainty:
    """As `propagate`, but each of `draws` takes errors from their distributions, corrects the recordings and fits them anew.

    The spread that the noise leaves is added to each refit by a normal draw with the covariance of the answer (JCGM 101, 5.9 and
    6.4); `low` and `high` are percentiles, the systematic parts those of `propagate`. Refits begin at the answer.
    """
    linear = propagate(problem, answer, errors)
    z, free = _start(problem, answer, errors)
    inside = free & (z > EDGE) & (z < 1 - EDGE)
    rng = np.random.default_rng(seed)
    drawn = {e: e.source.draw(rng, draws) for e in errors}
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    at = np.flatnonzero(inside)
    noise = _solver(problem, residuals, jacobian, at)[1]
    shaken = np.zeros((draws, len(z)))
    shaken[:, at] = rng.multivariate_normal(np.zeros(len(at)), noise, draws, method="eigh")
    found = np.empty((draws, len(z)))
    slope = _slope(problem, z)
    for i in range(draws):
        recordings = {n: e.recording for n, e in problem.experiments.items()}
        start = z.copy()
        for error, values in drawn.items():
            recordings = {n: error.corrected(r, values[i]) for n, r in recordings.items()}
            if error.kind == "constant":
                place = problem.space.names.index(error.of)
                start[place] += values[i] / slope[place]
        point, _ = refit(problem.with_recordings(recordings), start, free, FINE)
        found[i] = np.asarray(problem.space.physical(np.clip(point + shaken[i], 0.0, 1.0)))
    low, high = np.quantile(found, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    held = ~free
    low[held] = high[held] = linear.values[held]
    spread = np.where(held, 0.0, np.std(found, axis=0, ddof=1))
    return ParameterUncertainty(linear.names, linear.units, linear.values, linear.random, linear.systematic, spread, low, high, found)


def _start(problem: Problem, answer: Any, errors: Sequence[SharedError]) -> tuple[np.ndarray, np.ndarray]:
    """The cube point (d,), and which coordinates the fit had free."""
    z = np.array(getattr(getattr(answer, "best", None), "x", answer), dtype=float)
    free = np.ones(len(z), bool)
    for error in errors:
        if error.kind == "constant":
            if error.of not in problem.space.names:
                raise SpaceError(
                    f"The constant {error.of!r} is no free parameter of the problem; give it bounds around its value. Free are "
                    f"{list(problem.space.names)}."
                )
            free[problem.space.names.index(error.of)] = False
    return z, free


def _slope(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Derivative (d,) of the values by the cube coordinates."""
    return np.asarray(jax.jvp(problem.space.physical, (jnp.asarray(z),), (jnp.ones(len(z)),))[1])


def _solver(problem: Problem, residuals: np.ndarray, jacobian: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What takes residuals to moves of the coordinates `at` (q, m), and the covariance (q, q) that the noise gives them."""
    blocks, j = residual_blocks(problem), jacobian[:, at]
    variance = max(float(residuals @ residuals) / max(1, len(residuals) - len(at)), np.finfo(float).tiny)
    hessian = normal_matrix(j, blocks) / variance
    if problem.smoothing is not None:
        hessian = hessian + problem.smoothing.matrix[np.ix_(at, at)] / variance
    plain = np.linalg.inv(hessian + box_prior(hessian))
    return plain @ j.T / variance, covariance(j, residuals, blocks, np.ones(len(at), bool))


def _by_error(problem: Problem, z: np.ndarray, jacobian: np.ndarray, slope: np.ndarray, error: SharedError) -> np.ndarray:
    """Derivative (m,) of the residuals by the size of a shared error, the parameters held."""
    if error.kind == "constant":
        place = problem.space.names.index(error.of)
        return jacobian[:, place] / slope[place]
    step = error.source.standard
    if step == 0.0:
        return np.zeros(len(jacobian))
    ends = []
    for sign in (1.0, -1.0):
        recordings = {n: error.corrected(e.recording, sign * step) for n, e in problem.experiments.items()}
        ends.append(np.asarray(problem.with_recordings(recordings).unsmoothed.residuals(z)))
    return (ends[0] - ends[1]) / (2.0 * step)


def _named(problem: Problem, z: np.ndarray) -> tuple[tuple[str, ...], tuple[str | None, ...], np.ndarray]:
    return problem.space.names, tuple(c.unit for c in problem.space.coordinates), np.asarray(problem.space.physical(z))
