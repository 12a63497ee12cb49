"""What a study asks of maximum likelihood and Kalman filters, checked, and their answer as that of the study
(`estimator`)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpecError
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.kalman import kalman_filter
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.estimates_record import GENERALISED
from plantfit.estimate.methods.filter_answer import filter_answer
from plantfit.estimate.methods.levels import Asked, asked
from plantfit.estimate.methods.proposals import check_filterable
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.spec.tables import EstimateTable
from plantfit.spec.wished import table_in, wished
from plantfit.trust.finish.noise_weights import no_beginning
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.robust_or_classical import timed
from plantfit.trust.validate.residuals.ahead import pattern_ahead


def check_estimable(
    problem: Problem, wishes: Mapping[str, Any], table: Mapping[str, Any] | None = None
) -> tuple[EstimateTable, Asked]:
    """What is asked for, of a problem that filters work on; raises as `estimate_parameters`, before anything is
    fitted."""
    checked = estimate_table(problem, table, wishes)
    if any(m != GENERALISED for m in checked.methods):
        check_filterable(problem)
    if GENERALISED in checked.methods and not (problem.in_time or timed(problem)):
        raise SpecError(
            f"{problem.name!r} has no time: its rows may stand in any order, so that neighbours tell nothing of each "
            f"other and {GENERALISED} is least squares. Name the column of times (time under [recording.NAME]) if the "
            "rows are samples one after another."
        )
    if "kalman" in checked.methods:
        states = dict.fromkeys(problem.model.states, 1.0)  # pyrefly: ignore[missing-attribute]
        kalman_filter(problem, Noise({}, dict.fromkeys(problem.outputs, 1.0), states))
    return checked, asked(checked, problem)


def estimate_table(problem: Problem, table: Mapping[str, Any] | None, wishes: Mapping[str, Any]) -> EstimateTable:
    """The [estimate] table of a problem's study file with wishes that count before it. Raises SpecError."""
    file = problem.study_file
    if table is None:
        table = {} if file is None else table_in(file.text, "estimate", file.path)
    return wished(EstimateTable, table, wishes, "estimate_parameters")


def check_estimator(problem: Problem) -> None:
    """Raises as `check_estimable` for a problem whose answer is to be that of filters, which do not work on it."""
    if problem.by_filters:
        _asked(problem, None)


def filter_wishes(problem: Problem, spec: str | None) -> str:
    """What the answer by filters depends on beside problem and runs, as text; "" for other estimators."""
    return f"{problem.estimator} {_asked(problem, spec)[0].model_dump_json()}" if problem.by_filters else ""


def with_filter_answer(final: Problem, runs: Sequence[RunResult], spec: str | None, stated: bool) -> Problem:
    """The final problem of these runs with `Problem.filtered`, or with a sentence why not; as it is where nothing asks
    for it. `spec` is the text of the study file, `stated` whether errors of instruments are, whose effect is that on
    least squares."""
    if not final.by_filters:
        return final
    if stated:
        return final.with_answer(None, "errors of instruments are stated")
    if why := no_beginning(final, runs):
        return final.with_answer(None, why)
    local = linearise(final, min(runs, key=lambda r: r.cost).x)
    least = Estimate(tuple(final.space.names), local.values, local.covariance)
    found = filter_answer(final, least, *_asked(final, spec))
    if isinstance(found, str):
        return final.with_answer(None, found)
    why = pattern_ahead(final, found)
    return final.with_filtered(found) if why is None else final.with_answer(None, why)


def _asked(problem: Problem, spec: str | None) -> tuple[EstimateTable, Asked]:
    table = None if spec is None else table_in(spec, "estimate", Path("study.toml"))
    return check_estimable(problem, {"methods": [problem.estimator]}, table)


__all__ = ["check_estimable", "check_estimator", "estimate_table", "filter_wishes", "with_filter_answer"]
