"""Residuals that are not white, taken for noise that is correlated: whether such noise leaves the parameters where they
are, and what is known of them then."""

from collections.abc import Sequence

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.findings.residuals import CorrelatedNoise, CorrelatedResiduals, ResidualTest, WeightedParameter
from plantfit.problem.correlated.least_squares import weighted_least_squares
from plantfit.problem.problem import Problem
from plantfit.trust.finish.unknown_noise import unknown_noise
from plantfit.trust.intervals.linearised import Local
from plantfit.trust.intervals.robust_or_classical import timed

MOST = 3e6  # samples times parameters, beyond which a verdict does not wait for it


def correlated_residuals(problem: Problem, local: Local, tests: Sequence[ResidualTest]) -> CorrelatedResiduals | None:
    """By generalised least squares from the answer; None where all residuals are white, so slow that they are worth
    too few independent samples, or odd in one part of a record, and where the problem is not one of samples in time
    with plain parameters."""
    coloured = [t for t in tests if not t.white]
    if not coloured or any(t.stretch or t.turned for t in coloured):
        return None
    count = sum(problem.parts.counts.values())
    in_order, linear = problem.in_time or timed(problem), local.linear
    if not in_order or linear is None or not linear.sound:
        return None
    if unknown_noise(problem) or count * len(local.values) > MOST:
        return None
    space = problem.space
    try:
        found = weighted_least_squares(problem, dict(zip(space.names, local.values.tolist(), strict=True)))
    except SearchError:  # too few samples, or nothing but rounding is left
        return None
    test = found.difference
    parameters = [
        WeightedParameter(
            name=c.name, unit=c.unit, value=float(v), low=found.interval[c.name][0], high=found.interval[c.name][1]
        )
        for c, v in zip(space.coordinates, found.values, strict=True)
    ]
    return CorrelatedResiduals(
        noise=[CorrelatedNoise(**n.fields()) for n in found.noises],
        parameters=parameters,
        p=None if test is None else test.p,
        moved=None if test is None else test.name,
        differs=test is not None and test.differs,
    )
