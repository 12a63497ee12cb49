"""Maximum likelihood and Kalman filters from an answer by least squares."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import plantfit.runtime  # noqa: F401
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.agreement import Estimated
from plantfit.estimate.methods.estimates_record import LIKELIHOOD, noise_levels
from plantfit.estimate.methods.filtered import FILTERS, Wished, filtered
from plantfit.estimate.methods.levels import Asked
from plantfit.estimate.methods.likely import likely
from plantfit.estimate.methods.over_records import Runs
from plantfit.estimate.methods.proposals import Scales, proposed, scales_at, stepped_evenly
from plantfit.findings.filtered import NoiseLevel
from plantfit.problem.problem import Problem


class Wishes(Wished, Protocol):
    """What is asked of the filters, and the `budget` (evaluations) and `seed` of the likelihood's search."""

    @property
    def budget(self) -> int: ...
    @property
    def seed(self) -> int: ...


class ByFilters(NamedTuple):
    """What likelihood and filters found on the `problem` that they ran on; values that are
    `believed` most with their `worth`, and `levels` of noise as records."""

    problem: Problem
    noise: Noise
    scales: Scales
    likelihood: MaximumLikelihood | None
    believed: Mapping[str, float]
    worth: Estimate
    estimates: dict[str, Estimated]
    runs: dict[str, Runs]
    levels: Sequence[NoiseLevel]
    assumed: Sequence[str]


def by_filters(
    problem: Problem, least: Estimate, checked: Wishes, told: Asked, say: Callable[[str], None]
) -> ByFilters:
    """From the least-squares answer of a final problem: maximum likelihood where it is asked for or a level of noise
    is free, then the filters."""
    values = dict(least.named)
    problem = stepped_evenly(problem, values)
    scales = scales_at(problem, values)
    proposal = proposed(problem, scales, told.process, told.measurement, told.initial)
    likelihood, left_out = None, ()
    free = any(isinstance(v, tuple) for v in (*proposal.noise.process.values(), *proposal.noise.measurement.values()))
    if LIKELIHOOD in checked.methods or free:
        say(LIKELIHOOD)
        likelihood, left_out = likely(problem, proposal, values, checked.budget, checked.seed)
    noise = proposal.noise if likelihood is None else likelihood.noise
    believed = values if likelihood is None else likelihood.parameters
    worth = least if likelihood is None else likelihood.estimate
    errors = dict(zip(worth.names, worth.standard_error.tolist(), strict=True))
    runs, remarks = filtered(problem, noise, checked, told, (believed, errors), say)
    estimates: dict[str, Estimated] = {}
    if likelihood is not None and LIKELIHOOD in checked.methods:
        estimates[LIKELIHOOD] = of_likelihood(likelihood)
    estimates |= {FILTERS[m]: (r.estimate, r.interval) for m, r in runs.items() if m != "kalman"}
    levels = noise_levels(problem, noise, likelihood, proposal.proposed)
    assumed = [*proposal.assumed, *left_out, *remarks]
    return ByFilters(problem, noise, scales, likelihood, believed, worth, estimates, runs, levels, assumed)


def of_likelihood(found: MaximumLikelihood) -> Estimated:
    """The parameters of the likelihood without its levels; those at a bound have no interval."""
    own = slice(0, found.own)
    estimate = Estimate(found.estimate.names[own], found.estimate.values[own], found.estimate.covariance[own, own])
    return estimate, {n: ((None, None) if n in found.at_bound else found.interval[n]) for n in estimate.names}
