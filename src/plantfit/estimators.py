"""Parameters by maximum likelihood and Kalman filters beside least squares: what `plantfit estimate` does."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import ModelError, SimulationError, SpecError
from plantfit.estimate.comparison import SURE
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.beliefs import FilterRun
from plantfit.estimate.filters.consistency import chi_squared_test
from plantfit.estimate.filters.kalman import ekf, kalman_filter, ukf
from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.state_space import LOGIT_SPREAD
from plantfit.estimate.methods.agreement import Estimated, agreement
from plantfit.estimate.methods.levels import Asked, asked
from plantfit.estimate.methods.likely import likely
from plantfit.estimate.methods.over_records import Runs, over_recordings
from plantfit.estimate.methods.proposals import Scales, filterable, proposed, scales_at, stepped_evenly
from plantfit.estimate.methods.told import verdict_of
from plantfit.fitting import fit
from plantfit.problem.problem import Problem
from plantfit.report.case_page import write_case_page
from plantfit.report.pages.estimators import estimators_page, estimators_rows, noise_rows
from plantfit.report.text import columns
from plantfit.spec.study import Study
from plantfit.spec.tables import EstimateTable, validated

if TYPE_CHECKING:
    import polars as pl

LEAST_SQUARES, LIKELIHOOD = "least squares", "maximum likelihood"
FILTERS = {"ekf": "EKF", "ukf": "UKF", "kalman": "Kalman filter"}
NEAR = 5.0  # standard errors that a filter begins with near the answer; narrows its intervals by 2 %


@dataclass(frozen=True, repr=False, eq=False)
class Estimators:
    """What `estimate_parameters` found.

    `record` is plain data for JSON (docs/kalman.md). `noise` has the levels in force, for a filter of your own; `problem` is the problem
    that the filters ran on, `values` the parameters that are believed most: those of the likelihood, else of least squares, with their
    `covariance` (d, d) in the order of the `names` of its space. `runs` are the filters over the recordings, by method and recording.
    """

    record: Mapping[str, Any]
    answer: Answer = field(repr=False)
    problem: Problem = field(repr=False)
    noise: Noise
    scales: Scales = field(repr=False)
    likelihood: MaximumLikelihood | None
    runs: Mapping[str, Mapping[str, FilterRun]] = field(repr=False)
    values: Mapping[str, float]
    covariance: np.ndarray = field(repr=False)

    @property
    def agree(self) -> bool | None:
        """Whether no two methods differ by more than chance lets them; None where there are no two to compare."""
        return self.record["agree"]

    @property
    def verdict(self) -> str:
        """The sentences as lines of text."""
        return "\n".join(f"{v['level']:>8}: {v['sentence']}" for v in self.record["verdict"])

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, a row for each parameter and method: parameter, unit, method, value, low, high (95 %), truth."""
        import polars as pl

        rows = [
            {"parameter": p["name"], "unit": p["unit"], "method": m, **{k: e[k] for k in ("value", "low", "high")}, "truth": p["truth"]}
            for p in self.record["parameters"]
            for m, e in p["estimates"].items()
        ]
        numbers = dict.fromkeys(("value", "low", "high", "truth"), pl.Float64)
        return pl.DataFrame(rows, schema_overrides={"unit": pl.String, **numbers})

    def table(self) -> str:
        """Parameters and noise levels as text."""
        head, rows = estimators_rows(self.record, ascii_only=True)
        text = columns(head, rows, range(1, len(head)))
        head, rows = noise_rows(self.record, ascii_only=True)
        return f"{text}\n\n{columns(head, rows, range(1, len(head) - 1))}" if rows else text

    def report(self, path: str | Path) -> Path:
        """Write the page with the table and how each constant settles in each filter. Raises StoreError."""
        return write_case_page(estimators_page(self.record, self.runs), path)

    def __repr__(self) -> str:
        return f"{self.table()}\n\n{self.verdict}"


def estimate_parameters(
    study: Study | Answer | Problem,
    *,
    progress: Callable[[str], None] | None = None,
    table: Mapping[str, Any] | None = None,
    **wishes: Any,
) -> Estimators:
    """The parameters of a study by maximum likelihood, EKF and UKF beside least squares, with 95 % intervals, and whether they agree.

    `study`: an answer, or a study or problem that is fitted first. `wishes` are the keys of the study file's [estimate] table
    (docs/study-file.md), such as methods=["ekf"], measurement={"w": "2 rad/s"}, process={"i": (0.01, 10)}, truth={"R": 2.76}; they count
    before `table`, by default that of the answer's study file. Levels of noise that both leave out are proposed from the recordings and
    found by maximum likelihood; `record["assumed"]` says what was assumed. Seconds to a minute; `progress` is told what is being done.

    Raises ModelError for a model that no Kalman filter works on (dry friction, backlash, resets, late states, no states), SpecError and
    UnitError for wishes that cannot be, SpaceError for levels that are none, SearchError where the likelihood has no maximum.
    """
    say = progress or (lambda text: None)
    checked, told = check_estimable(study.problem if isinstance(study, Study | Answer) else study, wishes, table)
    if not isinstance(study, Answer):
        say("least squares")
    answer = _answer(study)
    values = answer.values
    problem = stepped_evenly(answer.problem, values)
    scales = scales_at(problem, values)
    proposal = proposed(problem, scales, told.process, told.measurement, told.initial)
    likelihood, left_out = None, ()
    free = any(isinstance(v, tuple) for v in (*proposal.noise.process.values(), *proposal.noise.measurement.values()))
    if LIKELIHOOD in checked.methods or free:
        say(LIKELIHOOD)
        likelihood, left_out = likely(problem, proposal, values, checked.budget, checked.seed)
    noise = proposal.noise if likelihood is None else likelihood.noise
    believed = values if likelihood is None else likelihood.parameters
    least = _least_squares(answer)
    worth = least[0] if likelihood is None else likelihood.estimate
    errors = dict(zip(worth.names, worth.standard_error.tolist(), strict=True))
    filters, remarks = _filtered(problem, noise, checked, told, (believed, errors), say)
    estimates = {LEAST_SQUARES: least}
    if likelihood is not None and LIKELIHOOD in checked.methods:
        estimates[LIKELIHOOD] = _of_likelihood(likelihood)
    estimates |= {FILTERS[m]: (r.estimate, r.interval) for m, r in filters.items() if m != "kalman"}
    truth = told.truth or known_truth(answer)
    say("comparing")
    record = {
        "name": problem.name,
        "methods": list(estimates),
        "parameters": _parameters(problem, estimates, truth, likelihood.at_bound if likelihood is not None else ()),
        "noise": _noise(problem, noise, likelihood, left_out, proposal.proposed),
        "filters": [_told_of(m, r) for m, r in filters.items()],
        "agreement": agreement(estimates),
        "assumed": [*proposal.assumed, *left_out, *remarks],
        "log_likelihood": None if likelihood is None else likelihood.log_likelihood,
    }
    tested = record["agreement"]
    record["agree"] = not any(p["differs"] for p in tested) if tested else None
    record["verdict"] = verdict_of(record, None if likelihood is None else likelihood.at_bound)
    runs = {FILTERS[m]: dict(r.runs) for m, r in filters.items()}
    matrix = _square(problem, worth)
    return Estimators(record, answer, problem, noise, scales, likelihood, runs, believed, matrix)


def check_estimable(problem: Problem, wishes: Mapping[str, Any], table: Mapping[str, Any] | None = None) -> tuple[EstimateTable, Asked]:
    """What is asked for, of a problem that filters work on; raises as `estimate_parameters`, before anything is fitted."""
    checked = estimate_table(problem, table, wishes)
    _refuse(problem)
    if "kalman" in checked.methods:
        states = dict.fromkeys(problem.model.states, 1.0)  # type: ignore[union-attr]
        kalman_filter(problem, Noise({}, dict.fromkeys(problem.outputs, 1.0), states))
    return checked, asked(checked, problem)


def estimate_table(problem: Problem, table: Mapping[str, Any] | None, wishes: Mapping[str, Any]) -> EstimateTable:
    """The [estimate] table of a problem's study file with wishes that count before it. Raises SpecError."""
    file = problem.study_file
    if table is None:
        own = validated(file.text, file.path).estimate if file is not None else EstimateTable.model_validate({})
        table = own.model_dump(exclude_unset=True)
    given = {**table, **{k: v for k, v in wishes.items() if v is not None}}
    unknown = [k for k in given if k not in EstimateTable.model_fields]
    if unknown:
        raise SpecError(f"estimate_parameters() does not know {unknown[0]!r}; it takes {', '.join(EstimateTable.model_fields)}.")
    try:
        return EstimateTable.model_validate(given)
    except ValueError as error:
        first = error.errors()[0]  # type: ignore[attr-defined]  (pydantic's)
        raise SpecError(f"{'.'.join(map(str, first['loc']))} = {first['input']!r} cannot be used: {first['msg'].lower()}.") from None


def known_truth(answer: Answer) -> dict[str, float]:
    """Parameters that a virtual rig has left beside the recordings as NAME_truth.json, those whose names are the study's."""
    file, problem = answer.problem.study_file, answer.problem
    path = file.path if file is not None else None
    if path is None and answer.spec is None:
        return {}
    table = validated(answer.spec, Path("study.toml")) if answer.spec else None
    folder = path.parent if path is not None else Path()
    found: dict[str, float] = {}
    for recording in table.recording.values() if table else ():
        beside = folder / Path(recording.file).with_suffix("")
        try:
            said = json.loads(beside.with_name(f"{beside.name}_truth.json").read_text("utf-8"))
        except (OSError, ValueError):
            continue
        own = said.get("parameters", said) if isinstance(said, dict) else {}
        if isinstance(own, dict):
            found |= {n: float(v) for n, v in own.items() if n in problem.space.names and isinstance(v, int | float)}
    return found


def _refuse(problem: Problem) -> None:
    try:
        filterable(problem)
    except ModelError as error:
        raise ModelError(
            f"{error} Write dry friction as tanh(v/width) and leave backlash and resets out; `plantfit run` fits the model as it is."
        ) from None


def _answer(study: Study | Answer | Problem) -> Answer:
    if isinstance(study, Answer):
        return study
    if isinstance(study, Problem):
        return fit(study)
    plan, method = study.plan, study.plan.methods[0]
    return fit(study.problem, method, runs=plan.runs, budget=plan.budget, seed=plan.seed, settings=plan.settings.get(method))


# -- methods ----------------------------------------------------------------------------------------


def _least_squares(answer: Answer) -> Estimated:
    rows = {row["name"]: row for row in answer.findings["parameters"]}
    names = answer.problem.space.names
    interval = {n: (rows[n]["low"], rows[n]["high"]) for n in names}
    return Estimate(names, np.array([answer.values[n] for n in names]), np.asarray(answer.covariance)), interval


def _of_likelihood(found: MaximumLikelihood) -> Estimated:
    own = slice(0, found.own)
    estimate = Estimate(found.estimate.names[own], found.estimate.values[own], found.estimate.covariance[own, own])
    return estimate, {n: ((None, None) if n in found.at_bound else found.interval[n]) for n in estimate.names}


def _filtered(
    problem: Problem,
    noise: Noise,
    table: EstimateTable,
    told: Asked,
    known: tuple[Mapping[str, float], Mapping[str, float]],
    say: Callable[[str], None],
) -> tuple[dict[str, Runs], list[str]]:
    """Runs by method, and what was assumed for them."""
    believed, errors = known  # values and standard errors
    late = {d.parameter for d in problem.model.delays}  # type: ignore[union-attr]
    held = {c.name: believed[c.name] for c in problem.space.coordinates if c.parameter in late}
    names = [n for n in problem.space.names if n not in held]
    kinds: dict[str, Callable[..., Any]] = {"ekf": ekf, "ukf": partial(ukf, kappa=table.kappa), "kalman": _plain}
    remarks = [
        f"{n}: held at {v:.5g} in the filters, because a dead time cannot be a state; their intervals leave out what is not known of it"
        for n, v in held.items()
    ]
    found: dict[str, Runs] = {}
    twice: list[str] = []
    for method in dict.fromkeys(m for m in table.methods if m in FILTERS):
        say(FILTERS[method])
        if method == "kalman":
            found[method] = over_recordings(_plain, problem, noise, (), at=believed, prior={}, drift={})
            continue
        begun: Runs | None = None
        run = partial(over_recordings, kinds[method], problem, noise, names, made={})
        if table.begin == "box":
            prior, drift = told.spreads(problem, names, held)
            with suppress(SimulationError):
                begun = run(at=held, prior=prior, drift=drift)
                if not prior and not drift:  # what is known beforehand counts once, and what wanders ends elsewhere than it began
                    begun = _again(run, problem, begun.estimate, believed, held, names)
                    twice.append(FILTERS[method])
        if begun is None or _too_sure(begun):
            at = _inside(problem, believed)
            prior, drift = told.spreads(problem, names, at)
            near = _near(problem, at, errors, names)
            again = run(at=at, prior=near | prior, drift=drift)
            if table.begin == "box":
                why = "it diverged" if begun is None else f"its innovations were {_factor(begun):.2g} times as large as it expected"
                remarks.append(
                    f"{FILTERS[method]}: began at the answer, {NEAR:g} standard errors wide, because from the middle of the box {why}"
                )
            begun = again
        found[method] = begun
    if twice:
        remarks.append(
            f"{' and '.join(twice)}: ran twice, from the middle of the box and then from where that ended, {NEAR:g} standard errors wide, "
            "because tangents taken far from the answer make intervals too narrow"
        )
    return found, remarks


def _again(
    run: Callable[..., Runs],
    problem: Problem,
    first: Estimate,
    believed: Mapping[str, float],
    held: Mapping[str, float],
    names: Sequence[str],
) -> Runs:
    """A filter run once more from where it ended."""
    own, errors = (dict(zip(first.names, v.tolist(), strict=True)) for v in (first.values, first.standard_error))
    at = {**_inside(problem, {**believed, **own}), **held}
    return run(at=at, prior=_near(problem, at, errors, names), drift={})


def _factor(runs: Runs) -> float:
    """By how much innovations are larger than a filter expects."""
    return float(np.sqrt(_told_of("ekf", runs)["nis"]["mean"] / np.mean([np.mean(r.measured[r.measured > 0]) for r in runs.runs.values()])))


def _too_sure(runs: Runs) -> bool:
    """Whether innovations are larger than a filter expects: curvature has misled it on its way from the box."""
    nis = _told_of("ekf", runs)["nis"]
    return nis["p"] < SURE and nis["mean"] > nis["high"]


def _near(problem: Problem, at: Mapping[str, float], errors: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Standard deviations of the filter's states of parameters that stand for so many standard errors, no wider than the box."""
    found = {}
    for c in problem.space.coordinates:
        if c.name in names and np.isfinite(errors.get(c.name, np.nan)) and errors[c.name] > 0:
            low, high, v = c.lower, c.upper, at[c.name]
            slope = 1.0 / v if c.log else (high - low) / ((v - low) * (high - v))
            widest = 0.25 * np.log(high / low) if c.log else LOGIT_SPREAD
            found[c.name] = float(min(NEAR * errors[c.name] * slope, widest))
    return found


def _plain(problem: Problem, noise: Noise, parameters: Sequence[str], *, at: Any, prior: Any, drift: Any, recording: str) -> Any:
    return kalman_filter(problem, noise, at=at, recording=recording)


def _inside(problem: Problem, values: Mapping[str, float]) -> dict[str, float]:
    """Values a hundredth of the box away from its bounds at least, where a bounded parameter can still move."""
    space = problem.space
    z = np.clip(np.asarray(space.cube(space.vector(values))), 0.01, 0.99)
    return dict(zip(space.names, np.asarray(space.physical(z)).tolist(), strict=True))


# -- the record -------------------------------------------------------------------------------------


def _parameters(
    problem: Problem, estimates: Mapping[str, Estimated], truth: Mapping[str, float], leaning: Sequence[str]
) -> list[dict[str, Any]]:
    rows = []
    for c in problem.space.coordinates:
        own = {}
        for method, (estimate, interval) in estimates.items():
            if c.name in estimate.names:
                i = estimate.names.index(c.name)
                error = float(estimate.standard_error[i])
                low, high = interval[c.name]
                own[method] = {
                    "value": float(estimate.values[i]), "standard_error": error if np.isfinite(error) and error > 0 else None,
                    "low": low, "high": high,
                    "at_bound": method == LIKELIHOOD and c.name in leaning,
                }  # fmt: skip
        rows.append({"name": c.name, "unit": c.unit, "truth": truth.get(c.name), "estimates": own})
    return rows


def _noise(
    problem: Problem, noise: Noise, found: MaximumLikelihood | None, left_out: Sequence[str], made: frozenset[str]
) -> list[dict[str, Any]]:
    units_of, rows = noise.parameters(problem.model), []  # type: ignore[arg-type]
    for kind, levels in (("process", noise.process), ("measurement", noise.measurement)):
        for name, value in levels.items():
            key = f"{kind} {name}"
            free = found is not None and key in found.interval
            leaning = free and key in found.at_bound  # type: ignore[union-attr]
            low, high = found.interval[key] if free and not leaning else (None, None)  # type: ignore[union-attr]
            how = "at a bound" if leaning else "found" if free else "left out" if key in made else "given"
            rows.append(
                {"kind": kind, "name": name, "unit": _unit(units_of[key].unit), "value": float(value), "low": low, "high": high, "how": how}  # type: ignore[arg-type]
            )
    return rows


def _unit(unit: str | None) -> str | None:
    """A/s^0.5 in place of (A)/s^0.5."""
    return unit if unit is None else re.sub(r"^\((\w+)\)", r"\1", unit)


def _told_of(method: str, runs: Runs) -> dict[str, Any]:
    every = list(runs.runs.values())
    nis = np.concatenate([r.nis[r.measured > 0] for r in every])
    test = chi_squared_test(nis, np.concatenate([r.measured[r.measured > 0] for r in every]))
    return {
        "method": FILTERS[method],
        "nis": {"mean": test.mean, "low": test.low, "high": test.high, "p": test.p_value, "consistent": test.consistent,
                "sentence": test.sentence},
        "memory": innovation_memory(every),
        "log_likelihood": float(sum(r.log_likelihood for r in every)),
    }  # fmt: skip


def innovation_memory(runs: Sequence[FilterRun]) -> dict[str, float]:
    """Correlation of neighbouring whitened innovations, by output; 0 where there are too few."""
    found = {}
    for i, name in enumerate(runs[0].plant.model.outputs):
        pairs, power, count = 0.0, 0.0, 0
        for r in runs:
            seen = np.isfinite(r.y[:, i])
            white = r.told["white"][r.rank, i][seen]
            pairs, power, count = pairs + float(white[1:] @ white[:-1]), power + float(white @ white), count + len(white)
        found[name] = pairs / power if power > 0 and count > 10 else 0.0
    return found


def _square(problem: Problem, estimate: Estimate) -> np.ndarray:
    at = [estimate.names.index(n) for n in problem.space.names]
    return estimate.covariance[np.ix_(at, at)]


__all__ = ["Estimators", "check_estimable", "estimate_parameters", "estimate_table", "innovation_memory", "known_truth"]
