"""Parameters by generalised least squares, maximum likelihood and Kalman filters beside least squares: what `plantfit
estimate` does."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import SpecError
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.beliefs import FilterRun, smoothed
from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.agreement import Estimated, agreement
from plantfit.estimate.methods.by_filters import by_filters
from plantfit.estimate.methods.estimates_record import (
    GENERALISED,
    LEAST_SQUARES,
    filter_findings,
    parameter_estimates,
)
from plantfit.estimate.methods.filtered import FILTERS
from plantfit.estimate.methods.generalised import generalised_least_squares
from plantfit.estimate.methods.proposals import Scales
from plantfit.estimate.methods.told import verdict_of
from plantfit.filter_answer import check_estimable, estimate_table
from plantfit.findings.results.estimated import EstimatesByMethod
from plantfit.findings.results.result import Result
from plantfit.fitting import fit
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.report.case_page import write_case_page
from plantfit.report.pages.estimators import estimators_page, estimators_rows, noise_rows
from plantfit.report.text import columns
from plantfit.spec.study import Study
from plantfit.spec.tables import validated
from plantfit.units import compatible, convert, difference_of

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True, repr=False, eq=False)
class Estimators(Result[EstimatesByMethod]):
    """What `estimate_parameters` found (docs/kalman.md).

    `noise` has the levels in force, for a filter of your own; `problem` is the problem
    that the filters ran on, `values` the parameters that are believed most: those of the likelihood, else of least
    squares, with their `covariance` (d, d) in the order of the `names` of its space. `runs` are the filters over the
    recordings, by method and recording.
    """

    answer: Answer = field(repr=False)
    problem: Problem = field(repr=False)
    noise: Noise
    scales: Scales | None = field(repr=False)
    likelihood: MaximumLikelihood | None
    runs: Mapping[str, Mapping[str, FilterRun]] = field(repr=False)
    values: Mapping[str, float]
    covariance: np.ndarray = field(repr=False)

    @property
    def agree(self) -> bool | None:
        """Whether no two methods differ by more than chance lets them; None where there are no two to compare."""
        return self.typed.agree

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, a row for each parameter and method: parameter, unit, method, value, low, high (95
        %), truth."""
        import polars as pl

        rows = [
            {
                "parameter": p.name,
                "unit": p.unit,
                "method": m,
                "value": e.value,
                "low": e.low,
                "high": e.high,
                "truth": p.truth,
            }
            for p in self.typed.parameters
            for m, e in p.estimates.items()
        ]
        numbers = dict.fromkeys(("value", "low", "high", "truth"), pl.Float64)
        return pl.DataFrame(rows, schema_overrides={"unit": pl.String, **numbers})

    def table(self) -> str:
        """Parameters and noise levels as text."""
        head, rows = estimators_rows(self.typed, ascii_only=True)
        text = columns(head, rows, range(1, len(head)))
        head, rows = noise_rows(self.typed, ascii_only=True)
        return f"{text}\n\n{columns(head, rows, range(1, len(head) - 1))}" if rows else text

    def states(self, recording: str | None = None, method: str | None = None) -> Recording:
        """The states over a recording as signals, filtered and smoothed, each with its standard deviation, in the unit
        of the state.

        `x_filtered` is what a filter believes of state x after each sample, `x_smoothed` what it believes given all
        samples (Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445); `x_filtered_error` and `x_smoothed_error` are their
        standard deviations. What is not known of the parameters that the filter estimates beside the states is in
        these. `method` is "EKF", "UKF" or "Kalman filter"; None takes the first filter and the first recording.

        Raises SpecError where no filter ran, or not over that recording.
        """
        if not self.runs:
            raise SpecError("No filter ran, so there are no states; take ekf, ukf or kalman into the methods.")
        method = next(iter(self.runs)) if method is None else method
        if method not in self.runs:
            raise SpecError(f"No filter {method!r} ran; there are {list(self.runs)}.")
        runs = self.runs[method]
        recording = next(iter(runs)) if recording is None else recording
        if recording not in runs:
            raise SpecError(f"The {method} did not run over {recording!r}; it ran over {list(runs)}.")
        run, signals = runs[recording], {}
        for kind, beliefs in (("filtered", run), ("smoothed", smoothed(run))):
            spread = np.sqrt(np.sum(beliefs.root**2, axis=2))
            for i, (name, unit) in enumerate(run.plant.model.states.items()):
                signals[f"{name}_{kind}"] = Signal(beliefs.mean[:, i], unit)
                signals[f"{name}_{kind}_error"] = Signal(spread[:, i], difference_of(unit))
        return Recording(
            run.t,
            signals,
            recording,
            (f"States by the {method}: filtered, from the samples so far, and smoothed, from all of them.",),
        )

    def report(self, path: str | Path) -> Path:
        """Write the page with the table and how each constant settles in each filter. Raises StoreError."""
        return write_case_page(estimators_page(self.typed, self.runs), path)


def estimate_parameters(
    study: Study | Answer | Problem,
    *,
    progress: Callable[[str], None] | None = None,
    table: Mapping[str, Any] | None = None,
    **wishes: Any,
) -> Estimators:
    """The parameters of a study by maximum likelihood, EKF and UKF, or by generalised least squares, beside least
    squares, with 95 % intervals, and whether they agree.

    `study`: an answer, or a study or problem that is fitted first. `wishes` are the keys of the study file's [estimate]
    table (docs/study-file.md), such as methods=["ekf"], measurement={"w": "2 rad/s"}, process={"i": (0.01, 10)},
    truth={"R": 2.76}; they count before `table`, by default that of the answer's study file. Levels of noise that both
    leave out are proposed from the recordings and found by maximum likelihood; `typed.assumed` says what was assumed.
    Seconds to a minute; `progress` is told what is being done.

    Raises ModelError for a model that no Kalman filter works on (dry friction, backlash, resets, late states, no
    states), SpecError and UnitError for wishes that cannot be, SpaceError for levels that are none, SearchError where
    the likelihood has no maximum.
    """
    say = progress or (lambda text: None)
    checked, told = check_estimable(study.problem if isinstance(study, Study | Answer) else study, wishes, table)
    if not isinstance(study, Answer):
        say("least squares")
    answer = _answer(study).by_least_squares
    least = _least_squares(answer)
    estimates, general, filters = {LEAST_SQUARES: least}, None, None
    if GENERALISED in checked.methods:
        say(GENERALISED)
        general = generalised_least_squares(answer.problem, answer.values)
        estimates[GENERALISED] = general.estimated
    if any(m != GENERALISED for m in checked.methods):
        filters = by_filters(answer.problem, least[0], checked, told, say)
        estimates |= filters.estimates
    truth = told.truth or known_truth(answer)
    say("comparing")
    tested = agreement(estimates, None if general is None else general.differs)
    leaning = None if filters is None or filters.likelihood is None else filters.likelihood.at_bound
    made = EstimatesByMethod(
        name=answer.problem.name,
        methods=list(estimates),
        parameters=parameter_estimates(answer.problem, estimates, truth, leaning or ()),
        noise=[] if filters is None else list(filters.levels),
        filters=[] if filters is None else [filter_findings(m, r) for m, r in filters.runs.items()],
        correlated=[] if general is None else list(general.noises),
        agreement=tested,
        assumed=[*(general.remarks if general is not None else ()), *(filters.assumed if filters is not None else ())],
        log_likelihood=filters.likelihood.log_likelihood if filters is not None and filters.likelihood else None,
        agree=not any(p.differs for p in tested) if tested else None,
    )
    made = made.having(verdict=verdict_of(made, leaning))
    if filters is None:
        problem, worth = answer.problem, estimates.get(GENERALISED, least)[0]
        covariance = _square(problem, worth)
        return Estimators(made, answer, problem, Noise({}, {}, {}), None, None, {}, worth.named, covariance)
    runs = {FILTERS[m]: dict(r.runs) for m, r in filters.runs.items()}
    covariance = _square(filters.problem, filters.worth)
    return Estimators(
        made, answer, filters.problem, filters.noise, filters.scales, filters.likelihood, runs, filters.believed,
        covariance,
    )  # fmt: skip


def known_truth(answer: Answer) -> dict[str, float]:
    """Parameters that a virtual rig has left beside the recordings, those whose names are the study's: of
    NAME.truth.json (`plantfit rig`) in the study's units, of NAME_truth.json (`RigRun.save`) as they are."""
    file, problem = answer.problem.study_file, answer.problem
    path = file.path if file is not None else None
    if path is None and answer.spec is None:
        return {}
    table = validated(answer.spec, Path("study.toml")) if answer.spec else None
    folder = path.parent if path is not None else Path()
    units = {c.name: c.unit for c in problem.space.coordinates if c.recording is None}
    found: dict[str, float] = {}
    for recording in table.recording.values() if table else ():
        beside = folder / recording.file
        stem = beside.name.removesuffix(".gz").rpartition(".")[0]
        old = _read_truth(beside.with_name(f"{stem}_truth.json"))
        own = old.get("parameters", old)
        if isinstance(own, dict):
            found |= {n: float(v) for n, v in own.items() if n in units and isinstance(v, int | float)}
        offered = _read_truth(beside.with_name(f"{stem}.truth.json"))
        for kind in ("constants", "determined"):
            own = offered.get(kind)
            for name, said in own.items() if isinstance(own, dict) else ():
                if name in units and isinstance(said, dict) and isinstance(said.get("value"), int | float):
                    unit, given = units[name] or "1", said.get("unit") or "1"
                    if compatible(given, unit):
                        found[name] = float(convert(said["value"], given, unit))
    return found


def _read_truth(file: Path) -> dict[str, Any]:
    try:
        said = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return said if isinstance(said, dict) else {}


def _answer(study: Study | Answer | Problem) -> Answer:
    if isinstance(study, Answer):
        return study
    if isinstance(study, Problem):
        return fit(study)
    plan, method = study.plan, study.plan.methods[0]
    return fit(
        study.problem, method, runs=plan.runs, budget=plan.budget, seed=plan.seed, settings=plan.settings.get(method)
    )


def _least_squares(answer: Answer) -> Estimated:
    rows = {row["name"]: row for row in answer.findings["parameters"]}
    names = answer.problem.space.names
    interval = {n: (rows[n]["low"], rows[n]["high"]) for n in names}
    return Estimate(names, np.array([answer.values[n] for n in names]), np.asarray(answer.covariance)), interval


def _square(problem: Problem, estimate: Estimate) -> np.ndarray:
    at = [estimate.names.index(n) for n in problem.space.names]
    return estimate.covariance[np.ix_(at, at)]


__all__ = ["Estimators", "check_estimable", "estimate_parameters", "estimate_table", "known_truth"]
