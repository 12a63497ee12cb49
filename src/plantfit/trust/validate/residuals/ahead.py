"""The answer of maximum likelihood or of a Kalman filter as findings: how well it foretells each sample from those
before it, beside least squares."""

from collections.abc import Iterator, Mapping

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.filtered import AheadScore, FilteredAnswer
from plantfit.findings.record import array
from plantfit.findings.residuals import ResidualTest
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.problem.problem import Problem
from plantfit.trust.validate.residuals.correlated import by_least_squares
from plantfit.trust.validate.residuals.over_records import each_test
from plantfit.trust.validate.residuals.residual_tests import within

LEAST = 10  # samples that a score is made of
SURE = 0.001  # chance with which a right model is refused


def filtered_answer(problem: Problem, z: np.ndarray, found: Filtered) -> FilteredAnswer:
    """`z` (d,) is the answer of least squares in the cube; `problem` a final one with `found` as its answer."""
    record = FilteredAnswer.model_validate(dict(found.told))
    return record.model_copy(
        update={
            "least_squares": by_least_squares(problem.with_answer(None), z),
            "ahead": list(_scores(problem, found.ahead)),
            "tests": _tests(problem, found),
        }
    )


def pattern_ahead(problem: Problem, found: Filtered) -> str | None:
    """What shows that noise of states does not explain all that is left of the outputs of a final problem, as a
    clause: errors one sample ahead that are not white or that follow an input, at 0.1 % of all tests together."""
    tests = [t for t in _tests(problem, found) if not t.shared]  # a pattern of these is known
    sure = SURE / max(1, sum(1 + len(t.cross) for t in tests))
    odd = [t for t in tests if t.p_value is not None and t.p_value < sure]
    if odd:
        worst = min(odd, key=lambda t: t.p_value or 0.0)
        return f"{_ahead_of(problem, worst)} are not white (p = {worst.p_value:.2g}), {_SO}"
    for t in tests:
        for name, cross in t.cross.items():
            if not within(array(cross.values), cross.bound or np.inf, sure):
                return f"{_ahead_of(problem, t)} are correlated with {name}, {_SO}"
    return None


_SO = "so that noise which moves the states does not explain all that is left, and the model lacks something"


def _ahead_of(problem: Problem, test: ResidualTest) -> str:
    where = f"{test.output} of {test.recording}" if len(problem.experiments) > 1 else test.output
    return f"one sample ahead the errors of {where}"


def _tests(problem: Problem, found: Filtered) -> list[ResidualTest]:
    """Of errors one sample ahead."""
    nothing = {n: np.full(len(e.recording), np.nan) for n, e in problem.experiments.items()}
    told = {n: found.ahead.get(n) or dict.fromkeys(problem.outputs, own) for n, own in nothing.items()}
    return list(each_test(problem, told))


def _scores(problem: Problem, ahead: Mapping[str, Mapping[str, np.ndarray]]) -> Iterator[AheadScore]:
    for name, own in ahead.items():
        experiment = problem.experiments[name]
        for output, told in own.items():
            error = told - experiment.recording[output]
            for part in ("fit", "validation"):
                use = experiment.mask(part) & np.isfinite(error)
                if use.sum() >= LEAST:
                    unit = problem.model.outputs[output] or experiment.recording.signals[output].unit
                    rmse = float(np.sqrt(np.mean(error[use] ** 2)))
                    yield AheadScore(
                        recording=name, output=output, unit=unit, part=part, n=int(use.sum()), rmse=rmse
                    )  # fmt: skip
