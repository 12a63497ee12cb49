"""Generalised least squares as one of the methods of `plantfit estimate`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.methods.agreement import Estimated
from plantfit.estimate.methods.estimates_record import GENERALISED, LEAST_SQUARES
from plantfit.findings.residuals import CorrelatedNoise
from plantfit.findings.results.estimated import MethodPair
from plantfit.problem.correlated.least_squares import weighted_least_squares
from plantfit.problem.correlated.weighted_answer import Difference
from plantfit.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class Generalised:
    """The `estimated` values and intervals, the noise of every output as a record, and sentences about what was
    assumed.

    `differs`: the test that least squares gives the same but for such noise; nothing where the two hardly can differ.
    """

    estimated: Estimated
    noises: tuple[CorrelatedNoise, ...]
    differs: MethodPair | None
    remarks: tuple[str, ...]
    z: np.ndarray


def generalised_least_squares(problem: Problem, values: Mapping[str, float]) -> Generalised:
    """From the least-squares answer `values` of a final problem, on any model; raises as `weighted_least_squares`."""
    found = weighted_least_squares(problem, values)
    estimate = Estimate(tuple(problem.space.names), found.values, found.covariance)
    test = None if found.difference is None else _tested(found.difference)
    noises = tuple(CorrelatedNoise(**n.fields()) for n in found.noises)
    return Generalised((estimate, found.interval), noises, test, found.remarks, found.z)


def _tested(found: Difference) -> MethodPair:
    verb = "differs" if found.differs else "does not differ"
    said = (
        f"Generalised least squares {verb} from least squares by more than such noise explains "
        f"(p = {found.p:.2g}), most in {found.name}: {found.after:.4g} in place of {found.before:.4g}."
    )
    if found.differs:
        said += (
            " Not all that is correlated is noise: look for what the model lacks (`plantfit diagnose`) before "
            "you believe either."
        )
    return MethodPair(
        first=GENERALISED, second=LEAST_SQUARES, statistic=found.statistic, degrees=found.degrees, p=found.p,
        sentence=said, p_adjusted=found.p, differs=found.differs,
    )  # fmt: skip


__all__ = ["Generalised", "generalised_least_squares"]
