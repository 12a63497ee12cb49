"""Residuals that are not white, taken for noise that is correlated: whether such noise leaves the parameters where they
are, and what is known of them then."""

from collections.abc import Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.findings.residuals import CorrelatedNoise, CorrelatedResiduals, ResidualTest, WeightedParameter
from plantfit.problem.correlated.least_squares import weighted_least_squares
from plantfit.problem.correlated.weighted_answer import Weighted
from plantfit.problem.problem import Problem
from plantfit.trust.finish.noise_weights import unweighable
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.ranges import linear_range


def correlated_residuals(
    problem: Problem, z: np.ndarray, local: Local, tests: Sequence[ResidualTest]
) -> CorrelatedResiduals | None:
    """By generalised least squares from the answer; None where all residuals are white, so slow that they are worth
    too few independent samples, or odd in one part of a record, and where the problem is not one of samples in time
    with plain parameters. Where it is the answer (`Problem.weighted`), least squares stands beside it, whose answer is
    the cube point z (d,)."""
    if problem.filtered is not None:
        return None
    if problem.weighted is not None:
        return _told(problem, problem.weighted, by_least_squares(problem.with_answer(None), z))
    coloured = [t for t in tests if not t.white]
    if not coloured or any(t.stretch or t.turned for t in coloured):
        return None
    if local.linear is None or not local.linear.sound or unweighable(problem):
        return None
    names = problem.space.names
    try:
        found = weighted_least_squares(problem, dict(zip(names, local.values.tolist(), strict=True)))
    except SearchError:  # too few samples, or nothing but rounding is left
        return None
    return _told(problem, found, None)


def by_least_squares(problem: Problem, z: np.ndarray) -> list[WeightedParameter]:
    """Values and intervals of least squares at its answer z (d,)."""
    local = linearise(problem, z)
    assert local.linear is not None
    ends = [linear_range(local.linear, i) for i in range(len(local.values))]
    both = zip(problem.space.coordinates, local.values.tolist(), ends, strict=True)
    return [WeightedParameter(name=c.name, unit=c.unit, value=v, low=r.low, high=r.high) for c, v, r in both]


def _told(problem: Problem, found: Weighted, least: list[WeightedParameter] | None) -> CorrelatedResiduals:
    test, both = found.difference, zip(problem.space.coordinates, found.values.tolist(), strict=True)
    ends = found.interval
    return CorrelatedResiduals(
        noise=[CorrelatedNoise(**n.fields()) for n in found.noises],
        parameters=[
            WeightedParameter(name=c.name, unit=c.unit, value=v, low=ends[c.name][0], high=ends[c.name][1])
            for c, v in both
        ],
        p=None if test is None else test.p,
        moved=None if test is None else test.name,
        differs=test is not None and test.differs,
        least_squares=least,
    )
