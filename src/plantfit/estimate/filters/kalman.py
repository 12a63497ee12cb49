"""Kalman filters over the states of a model and, if wished, its parameters: linear, extended, unscented.

run = ekf(problem, noise, ["Rm", "Jm"]).run()      over a recording: run.track("Rm"), run.interval, smoothed(run)
now = ekf(problem, noise).online()                 sample by sample: now.update(t, {"V": 3.0}, {"w": 12.5})
"""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from plantfit.errors import ModelError, SpaceError
from plantfit.estimate.filters.filter import Filter
from plantfit.estimate.filters.filter_step import linearised, unscented
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.state_space import state_space
from plantfit.problem.problem import Problem


def kalman_filter(
    problem: Problem, noise: Noise, *, at: Mapping[str, float] | None = None, recording: str | None = None
) -> Filter:
    """The Kalman filter of a linear model, its steps exact (matrix exponentials).

    `at`: parameter values by name, by default the starts of the space or the middle of its box. `recording` as in
    `ekf`. Raises ModelError for a model that is not linear in its states and inputs.
    """
    plant = state_space(problem, noise, (), recording)
    if not plant.exact:
        raise ModelError(
            f"Model {plant.model.name!r} is not linear in its states and inputs, or has a dead time; use ekf or ukf."
        )
    return Filter(problem, plant, noise, linearised, at)


def ekf(
    problem: Problem,
    noise: Noise,
    parameters: Sequence[str] = (),
    *,
    at: Mapping[str, float] | None = None,
    prior: Mapping[str, float] | None = None,
    drift: Mapping[str, float] | None = None,
    recording: str | None = None,
) -> Filter:
    """The extended Kalman filter over the states and, as states that hardly move, the named `parameters` of the
    problem.

    They begin at `at` (by default the starts of the space, else the middle of its box) with a standard deviation
    `prior`, which is relative for a parameter on a log scale (the state is its logarithm) and of the logit within the
    bounds on a linear one; by default two of them reach the ends of the box. `drift`: by how much they wander in a
    second, by default not at all. Missing measurements are skipped. `recording` names one of several.

    Jazwinski, Stochastic Processes and Filtering Theory (1970), theorem 8.1, with the covariance of process noise of
    the tangent.
    """
    plant = state_space(problem, noise, parameters, recording)
    return Filter(problem, plant, noise, linearised, at, prior, drift)


def ukf(
    problem: Problem,
    noise: Noise,
    parameters: Sequence[str] = (),
    *,
    at: Mapping[str, float] | None = None,
    prior: Mapping[str, float] | None = None,
    drift: Mapping[str, float] | None = None,
    recording: str | None = None,
    kappa: float = 0.0,
) -> Filter:
    """The unscented Kalman filter; arguments as in `ekf`, `kappa` at least 0 as in `unscented`."""
    if not (np.isfinite(kappa) and kappa >= 0):
        raise SpaceError(f"kappa = {kappa}; give a number of at least 0, so that no weight is negative.")
    plant = state_space(problem, noise, parameters, recording)
    return Filter(problem, plant, noise, partial(unscented, float(kappa)), at, prior, drift)
