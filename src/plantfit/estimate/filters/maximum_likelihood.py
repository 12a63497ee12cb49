"""Parameters and noise levels of largest likelihood, by the prediction errors of a Kalman filter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import FlatLikelihood, SearchError, SpaceError
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.filter_step import linearised, unscented
from plantfit.estimate.filters.likelihood import Innovations
from plantfit.estimate.filters.noise import Level, Noise
from plantfit.estimate.filters.state_space import Record
from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective
from plantfit.problem.measure.long_run import prewhitened_long_run
from plantfit.problem.problem import Problem
from plantfit.space import Space

import jax
import jax.numpy as jnp

NEWTON_STEPS = 12
SETTLED = 1e-10  # decrease of the log-likelihood that Newton's method expects at its end
NEAR_BOUND = 1e-6  # of the box
Kind = Literal["sandwich", "hessian"]


@dataclass(frozen=True, eq=False)
class MaximumLikelihood:
    """`estimate` of the problem's free parameters, then the free noise levels "process x" and "measurement y", in their
    units.

    With one recording its influences are there, numbered by the samples that have a measurement.

    `interval` gives 95 % intervals, symmetric on each parameter's scale. `noise` has the levels found, for a filter;
    `parameters` are the problem's alone. `at_bound` names what leans against its box: held there, with no standard
    error. `gradient` is the largest slope left along a free coordinate, in units of the log-likelihood for one standard
    error.
    """

    estimate: Estimate
    interval: dict[str, tuple[float, float]]
    noise: Noise
    log_likelihood: float
    count: int
    at_bound: tuple[str, ...]
    gradient: float
    own: int = field(repr=False)

    @property
    def parameters(self) -> dict[str, float]:
        """The problem's parameters by name."""
        return dict(list(self.estimate.named.items())[: self.own])

    @property
    def sentence(self) -> str:
        held = f"; at a bound: {', '.join(self.at_bound)}" if self.at_bound else ""
        size = f"{self.log_likelihood:.6g} of {self.count} measurements"
        return (
            f"Maximum likelihood: log-likelihood {size}, the slope "
            f"left is {self.gradient:.1g} for a standard error{held}."
        )


def maximum_likelihood(
    problem: Problem,
    noise: Noise,
    *,
    filter: Literal["ekf", "ukf"] = "ekf",
    kappa: float = 0.0,
    covariance: Kind = "sandwich",
    budget: int = 300,
    seed: int = 0,
    start: Mapping[str, float] | None = None,
) -> MaximumLikelihood:
    """The free parameters of a problem and the noise levels that `noise` gives as pairs, over the fitted parts of all
    recordings.

    L-BFGS-B with exact gradients from the starts of the space (the middle of the box) and then from random points,
    `budget` evaluations in all, ends in Newton steps with the exact Hessian H. `covariance` "hessian" is its inverse;
    "sandwich" is H^-1 S H^-1 with the long-run covariance S of the scores (White, Econometrica 50 (1982) 1, eq.
    (2.10)), which also holds where the noise is not as the model says. Its standard errors are no less than those by H:
    where few samples fix a value, it follows their noise and hides it from S. For a linear model the likelihood is
    exact, else that of the extended ("ekf") or unscented ("ukf") filter: Astrom, Automatica 16 (1980) 551; Kristensen,
    Madsen, Jorgensen, Automatica 40 (2004) 225.

    `start`: values of parameters and levels ("process x") from which the search begins before all others, by name, in
    their units.

    Raises SearchError when nothing is free or no start can be filtered, FlatLikelihood where the recordings leave
    something open, and SpaceError for names in `start` that are not free.
    """
    spreads = {"ekf": linearised, "ukf": partial(unscented, float(kappa))}
    if filter not in spreads:
        raise SearchError(f"filter = {filter!r}; use 'ekf' or 'ukf'.")
    likelihood = Innovations.of(problem, noise, spreads[filter])
    return maximised(likelihood, likelihood.records(problem), noise, covariance, budget, seed, start)


def maximised(
    likelihood: Innovations,
    records: Sequence[Record],
    noise: Noise,
    covariance: Kind = "sandwich",
    budget: int = 300,
    seed: int = 0,
    start: Mapping[str, float] | None = None,
) -> MaximumLikelihood:
    """As `maximum_likelihood`, for a likelihood made once for many records of the same lengths."""
    if covariance not in ("sandwich", "hessian"):
        raise SearchError(f"covariance = {covariance!r}; use 'sandwich' or 'hessian'.")
    records, space = tuple(records), likelihood.space
    count = int(sum(np.sum(np.isfinite(r.y)) for r in records))
    z = _searched(likelihood, records, count, budget, seed, start)
    z, value, slope, hessian = _polished(likelihood, records, z)
    free = ~_leaning(z, slope)
    inverse = np.zeros((len(z), len(z)))
    inverse[np.ix_(free, free)] = _inverse(
        hessian[np.ix_(free, free)], [n for n, f in zip(space.names, free, strict=True) if f]
    )
    # rows without a measurement say nothing, and their zeros would hide how the others are correlated
    scores = [s[np.any(s != 0.0, axis=1)] for s in map(np.asarray, likelihood.scores(z, records))]
    spread = inverse
    if covariance == "sandwich":
        spread = sum(prewhitened_long_run(s @ inverse, np.arange(len(s))) for s in scores)
        wider = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(spread), 1e-300), 1.0))
        spread = spread * np.outer(wider, wider)
    scale = np.where(
        space.log,
        np.log(np.where(space.log, space.upper / np.where(space.log, space.lower, 1.0), 1.0)),
        space.upper - space.lower,
    )
    values = np.asarray(space.physical(z))
    tangent = np.where(space.log, values * scale, scale)
    sd = np.sqrt(np.diag(spread)) * 1.959963984540054
    low, high = (np.asarray(space.physical(z + k * sd)) for k in (-1, 1))
    one = len(records) == 1
    estimate = Estimate(
        space.names,
        values,
        spread * np.outer(tangent, tangent),
        -scores[0] @ inverse * tangent if one else None,
        np.arange(len(scores[0])) if one else None,
    )
    named = estimate.named
    return MaximumLikelihood(
        estimate,
        {n: (float(a), float(b)) for n, a, b in zip(space.names, low, high, strict=True)},
        _found(noise, named),
        -value,
        count,
        tuple(n for n, f in zip(space.names, free, strict=True) if not f),
        float(np.max(np.abs(slope[free]) * np.sqrt(np.diag(inverse)[free]), initial=0.0)),
        sum(not n.startswith(("process ", "measurement ")) for n in space.names),
    )


def _searched(
    likelihood: Innovations,
    records: tuple[Record, ...],
    count: int,
    budget: int,
    seed: int,
    given: Mapping[str, float] | None,
) -> np.ndarray:
    space = likelihood.space

    def value_and_gradient(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = likelihood.values_and_gradients(jnp.asarray(z), records)
        return float(value) / count, np.asarray(gradient) / count

    def costs(zs: Any) -> Any:
        values = jax.lax.map(lambda z: likelihood.value(z, records), zs) / count
        return jnp.where(jnp.isfinite(values), values, jnp.inf)

    start = np.full(space.dimension, 0.5) if space.start is None else space.start
    starts = start[None, :] if given is None else np.stack([_place(space, given, start), start])
    objective = Objective(
        space.dimension, costs, value_and_gradient, start=starts, lower=space.lower, upper=space.upper
    )
    found = minimise(objective, "lbfgsb", budget=budget, seed=seed, settings={"max_steps": max(10, budget // 6)})[0]
    if not np.isfinite(found.cost):
        raise SearchError(
            "The filter could not follow any start; narrow the box, "
            "start nearer, or give the noise levels wider ranges."
        )
    return np.asarray(found.x)


def _place(space: Space, given: Mapping[str, float], other: np.ndarray) -> np.ndarray:
    """The cube point (d,) of named values, moved into their bounds, with `other` where nothing is given."""
    wrong = [n for n in given if n not in space.names]
    if wrong:
        raise SpaceError(f"start names {wrong[0]!r}, which is not free; free are {list(space.names)}.")
    values = np.asarray(space.physical(other)).copy()
    for name, value in given.items():
        values[space.names.index(name)] = value
    return np.clip(np.asarray(space.cube(np.clip(values, space.lower, space.upper))), 0.0, 1.0)


def _polished(
    likelihood: Innovations, records: tuple[Record, ...], z: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Newton's method with halved steps inside the box: point, value, gradient, Hessian."""

    def at(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = likelihood.values_and_gradients(jnp.asarray(z), records)
        return float(value), np.asarray(slope)

    value, slope = at(z)
    hessian = np.asarray(likelihood.hessian(z, records))
    if not np.all(np.isfinite(hessian)):
        raise SearchError(
            "The likelihood has no second derivatives where the search ended; give some process noise or other starts."
        )
    for _ in range(NEWTON_STEPS):
        free = ~_leaning(z, slope)
        step = np.zeros_like(z)
        w, v = np.linalg.eigh(hessian[np.ix_(free, free)])
        turned = v.T @ slope[free]
        step[free] = -v @ (turned / np.maximum(np.abs(w), 1e-8 * np.max(np.abs(w), initial=1e-300)))
        if -slope @ step < SETTLED:
            break
        for share in 0.5 ** np.arange(20):
            trial = np.clip(z + share * step, 0.0, 1.0)
            new, new_slope = at(trial)
            if np.isfinite(new) and new < value:
                break
        else:
            break
        z, value, slope = trial, new, new_slope
        hessian = np.asarray(likelihood.hessian(z, records))
    return z, value, slope, hessian


def _leaning(z: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Coordinates on a bound that the likelihood would cross."""
    return ((z < NEAR_BOUND) & (slope > 0)) | ((z > 1 - NEAR_BOUND) & (slope < 0))


def _inverse(hessian: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Inverse of a Hessian; raises SearchError naming the direction in which the likelihood is flat."""
    w, v = np.linalg.eigh(hessian)
    if len(w) and w[0] <= 1e-10 * w[-1]:
        share = np.abs(v[:, 0])
        flat = [n for n, s in zip(names, share, strict=True) if s > 0.3 * share.max()]
        raise FlatLikelihood(flat)
    return v @ np.diag(1.0 / w) @ v.T


def _found(noise: Noise, named: dict[str, float]) -> Noise:
    def levels(kind: str) -> dict[str, Level]:
        return {
            n: named[f"{kind} {n}"] if isinstance(level, tuple) else level for n, level in getattr(noise, kind).items()
        }

    return Noise(levels("process"), levels("measurement"), noise.initial)
