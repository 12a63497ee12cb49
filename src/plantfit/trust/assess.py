"""What an answer is worth: one plain record from a problem and the runs that were made on it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.parameters import Combination, Parameter, StandardErrors
from plantfit.findings.record import Values
from plantfit.findings.recordings import Input, Output, Recording, Score
from plantfit.findings.residuals import ResidualTest, ShortRecordings, Turned
from plantfit.findings.runs import Basin, History, Run
from plantfit.findings.simulation import Forgets, Reproduction, SimulatedOutput, Simulation
from plantfit.findings.whole import VERSION, Findings
from plantfit.models.model import Model
from plantfit.optimize.contract import RunResult
from plantfit.problem.accuracy.verification import error_of, least_exact
from plantfit.problem.problem import Problem
from plantfit.problem.shooting.forgetting import forgetting_of_lost
from plantfit.simulate.check.verify import by_doubling
from plantfit.simulate.simulator import Drive
from plantfit.study.comparing.basins import basins
from plantfit.study.versions import cpu_model, versions
from plantfit.trust.finish.agreement import SAME, agreement, named, opened
from plantfit.trust.finish.final_problem import CHECKED, rounding
from plantfit.trust.finish.noise_weights import weighted_ranges
from plantfit.trust.finish.smoothing_strength import smoothing_rows
from plantfit.trust.finish.unknown_noise import as_known
from plantfit.trust.finish.weights import weight_rows
from plantfit.trust.heterogeneity.findings import heterogeneity_findings, withdrawn
from plantfit.trust.identify.determined import determined_findings
from plantfit.trust.identify.table_visits import agreeing, table_visits
from plantfit.trust.intervals.follow.following import followed_ranges
from plantfit.trust.intervals.follow.other_answers import holding_others
from plantfit.trust.intervals.linearised import EDGE as EDGE
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.misreadings import allowing_for_misreadings, claimed
from plantfit.trust.intervals.parameter_rows import NOT_VISITED, parameter_rows, table_rows, with_delays
from plantfit.trust.intervals.robust_or_classical import has_times
from plantfit.trust.looks import hold_looks, not_followed, problem_looks
from plantfit.trust.stated_errors.findings import uncertainty_findings
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.validate.foretold import with_foretold
from plantfit.trust.validate.residuals.ahead import filtered_answer
from plantfit.trust.validate.residuals.correlated import correlated_residuals
from plantfit.trust.validate.residuals.over_records import each_test
from plantfit.trust.validate.residuals.residual_tests import (
    short_recordings,
)
from plantfit.trust.validate.residuals.turned import turned_records
from plantfit.trust.validate.spare_samples import with_spare
from plantfit.trust.validate.unseen_starts import with_started
from plantfit.trust.verdict.all_sentences import sentences
from plantfit.trust.verdict.outputs import GOOD, ROUNDING, WHITE


def assess(
    problem: Problem,
    runs: Sequence[RunResult],
    *,
    seed: int,
    spec: str | None = None,
    command: str = "",
    seconds: Mapping[str, float] | None = None,
    verify: bool = True,
    errors: Sequence[SharedError] = (),
    draws: int | None = None,
) -> dict[str, Any]:
    """The findings (`plantfit.findings.Findings`) for the best of `runs`, as JSON types.

    Shared `errors` widen the intervals (section "uncertainty"): to first order, or by so many `draws`.
    """
    best = min(runs, key=lambda r: r.cost)
    weighted = problem.own_estimate
    z = best.x if weighted is None else weighted.z
    local = linearise(problem, z)
    predictions = {name: problem.predict(local.values, name) for name in problem.experiments}
    visits, unseen = agreeing(
        table_visits(problem, local.values), dict(zip(problem.space.names, local.touched.tolist(), strict=True))
    )
    ranges, spent = None, float(sum(r.evaluations for r in runs))
    if weighted is not None:
        ranges = weighted_ranges(problem, weighted)
    elif local.linear is not None:
        ranges = followed_ranges(problem, z, local.linear, spent, _other_ends(runs, best))
    rows = parameter_rows(problem.space, local, unseen, ranges)
    if local.linear is None:
        rows = holding_others(problem, z, local, rows, _other_ends(runs, best))
    rows = with_delays(problem.model, rows)
    agreed = agreement(problem, runs)
    rows = rows if weighted is not None else opened(rows, agreed.ranges)
    rows, stepped = allowing_for_misreadings(as_known(problem), z, local, rows)
    determined = claimed(determined_findings(problem, local.linear, rows, ranges or {}), rows)
    rows, uncertainty = uncertainty_findings(problem, z, rows, errors, draws, seed)
    rows, heterogeneity = heterogeneity_findings(problem, z, local, rows, spent)
    if determined is not None:
        determined = determined.model_copy(update={"count": determined.count - len(withdrawn(rows))})
    tests = _with_turned(problem, predictions, list(each_test(problem, predictions, not local.robust)))
    scores = with_spare(problem, z, local, list(_scores(problem, predictions)))
    short = list(_short_recordings(problem, predictions, tests))
    scores = with_started(problem, local.values, scores, [*tests, *short])
    scores = with_foretold(problem, local, scores, [*tests, *short])
    fixed = [row["name"] for row in rows if row["status"] == "determined"]
    found = Findings(
        schema_version=VERSION,
        name=problem.name,
        recordings=[_recording(problem, n, predictions[n]) for n in problem.experiments],
        scores=scores,
        residual_tests=tests,
        short_recordings=short,
        correlated=correlated_residuals(problem, best.x, local, tests),
        filtered=None if problem.filtered is None else filtered_answer(problem, best.x, problem.filtered),
        data=[
            *not_followed(problem_looks(problem, fixed), problem, z),
            *stepped,
            *hold_looks(problem, z, rows, all(test.white for test in [*tests, *short])),
        ],
        diagnosis=None,
        parameters=[Parameter(**row) for row in rows],
        differentiated=list(problem.differentiated),
        uncertainty=uncertainty,
        standard_errors=StandardErrors(
            kind="robust" if local.robust else "classical",
            in_time=problem.in_time,
            not_weighted=problem.not_weighted,
            estimator=problem.estimator,
            filterable=_filterable(problem),
        ),
        tables=table_rows(problem, rows, visits),
        smoothing=smoothing_rows(problem, local),
        combinations=_combinations(local, rows),
        heterogeneity=heterogeneity,
        determined=determined,
        runs=[_run(problem, r) for r in runs],
        basins=_basins(problem, runs),
        agreement=agreed,
        weights=weight_rows(problem),
        simulation=_simulation(problem, z, local.values, verify, scores),
        reproduction=Reproduction(
            spec=spec, seed=seed, versions=versions(), cpu=cpu_model(), seconds=dict(seconds or {}), command=command
        ),
    ).plain()
    return {**found, "verdict": sentences(found, best)}


def _filterable(problem: Problem) -> bool:
    model = problem.model
    moves = isinstance(model, Model) and bool(model.states) and model.smooth
    return moves and not any(e.steady for e in problem.experiments.values())


def _other_ends(runs: Sequence[RunResult], best: RunResult) -> list[np.ndarray]:
    """Where other runs and the searches within runs ended, the lowest first."""
    ends = sorted((r for r in runs if r is not best and np.isfinite(r.cost)), key=lambda r: r.cost)
    within = [z for r in (best, *ends) for key in ("elsewhere", "nearly") for z in r.extra.get(key, ())]
    return [np.asarray(z, dtype=float) for z in (*(r.x for r in ends), *within)]


def _parts(problem: Problem, name: str) -> dict[str, np.ndarray]:
    experiment = problem.experiments[name]
    return {"fit": experiment.mask("fit"), "validation": experiment.mask("validation")}


def _recording(problem: Problem, name: str, predicted: Mapping[str, np.ndarray]) -> Recording:
    record = problem.experiments[name].recording
    masks = _parts(problem, name)
    part = np.where(masks["fit"], "fit", np.where(masks["validation"], "validation", ""))
    inputs = getattr(problem.model, "inputs", None) or getattr(problem.model, "signals", {})
    return Recording(
        name=name,
        log=list(record.log),
        t=record.t.tolist(),
        timed=problem.in_time or has_times(record),
        inputs={
            n: Input(unit=record.signals[n].unit, values=_listed(record[n])) for n in inputs if n not in problem.outputs
        },
        outputs={
            o: Output(
                unit=_unit(problem, o), measured=_listed(record[o]), simulated=_listed(predicted[o]), part=part.tolist()
            )
            for o in problem.outputs
        },
    )


def _unit(problem: Problem, output: str) -> str | None:
    for experiment in problem.experiments.values():
        if experiment.recording.signals[output].unit:
            return problem.model.outputs[output] or experiment.recording.signals[output].unit
    return problem.model.outputs[output]


def _listed(values: Any) -> Values:
    return [float(v) if np.isfinite(v) else None for v in np.asarray(values)]


def _scores(problem: Problem, predictions: Mapping[str, Mapping[str, np.ndarray]]) -> Iterator[Score]:
    for name, experiment in problem.experiments.items():
        for output in problem.outputs:
            y, fit = experiment.recording[output], predictions[name][output]
            for part, mask in _parts(problem, name).items():
                use = mask & np.isfinite(y)
                if use.sum() < 2:
                    continue
                error = fit[use] - y[use]
                spread = np.linalg.norm(y[use] - y[use].mean())
                yield Score(
                    recording=name,
                    output=output,
                    unit=_unit(problem, output),
                    part="fit" if part == "fit" else "validation",
                    n=int(use.sum()),
                    rmse=float(np.sqrt(np.mean(error**2))),
                    bias=float(error.mean()),
                    fit_percent=float(100 * (1 - np.linalg.norm(error) / spread)) if spread > 0 else None,
                )


def _with_turned(
    problem: Problem, predictions: Mapping[str, Mapping[str, np.ndarray]], tests: Sequence[ResidualTest]
) -> list[ResidualTest]:
    """The tests, with the recordings that as a whole move against the simulation."""
    against: dict[tuple[str, str], Turned] = {}
    for output in problem.outputs if problem.in_time else ():
        records = {}
        for test in tests:
            if test.output == output:
                e = problem.experiments[test.recording]
                at = e.mask("fit") & np.isfinite(e.recording[output])
                records[test.recording] = (
                    e.recording.t[at],
                    e.recording[output][at],
                    predictions[test.recording][output][at],
                )
        against |= {(name, output): t for name, t in turned_records(records).items()}
    return [
        t.model_copy(update={"turned": against[t.recording, t.output], "stretch": None})
        if (t.recording, t.output) in against and not t.white
        else t
        for t in tests
    ]


def _short_recordings(
    problem: Problem, predictions: Mapping[str, Mapping[str, np.ndarray]], tests: Sequence[ResidualTest]
) -> Iterator[ShortRecordings]:
    """What recordings without a test of their own say together."""
    tested = {(t.recording, t.output) for t in tests}
    for output in problem.outputs if problem.in_time else ():
        own: dict[str, np.ndarray] = {}
        for name, e in problem.experiments.items():
            y = e.recording[output]
            error = np.where(e.mask("fit"), y - predictions[name][output], np.nan)
            error = error[np.isfinite(error)]
            solved = np.max(np.abs(error), initial=0.0) <= ROUNDING * np.nanmax(np.abs(y), initial=0.0)
            other = e.steady or output in e.shared_errors
            if len(error) and not solved and not other and (name, output) not in tested:
                own[name] = error
        if found := short_recordings(list(own.values())):
            yield ShortRecordings(
                output=output,
                recordings=list(own),
                correlation=found[0],
                white=bool(found[1] > WHITE),
                p_value=found[1],
            )


def _combinations(local: Local, rows: Sequence[Mapping[str, Any]]) -> list[Combination]:
    """All directions, the worst first; one of a single parameter only when its row does not say so already."""
    told = {row["name"] for row in rows if row["status"] in ("flat", "at bound", NOT_VISITED)}
    unseen = {row["name"] for row in rows if row["status"] == NOT_VISITED}
    kept = [d for d in local.directions if not (told if len(d.weights) == 1 else unseen).issuperset(d.weights)]
    kept.sort(key=lambda d: (len(d.weights) == 1, -d.relative_sd))
    said = [d.sentence if local.linear is None else d.moves for d in kept]
    return [
        Combination(sentence=s, weights=dict(d.weights), relative_sd=d.relative_sd)
        for s, d in zip(said, kept, strict=True)
    ]


def _run(problem: Problem, r: RunResult) -> Run:
    one = len(problem.outputs) == 1
    squares = r.cost if problem.smoothing is None else float(problem.unsmoothed.costs(r.x[None, :])[0])
    return Run(
        method=r.method,
        run=r.run,
        seed=r.seed,
        cost=float(r.cost),
        rmse=float(np.sqrt(squares)) * (problem.scales[problem.outputs[0]] if one else 1.0)
        if np.isfinite(r.cost)
        else None,
        status=str(r.status),
        ended=str(r.extra.get("ended", "")),
        evaluations=float(r.evaluations),
        seconds=float(r.seconds),
        failures=int(r.failures),
        parameters=named(problem, r.x),
        searched=named(problem, r.extra["searched"]) if "searched" in r.extra else {},
        history=History(evaluations=np.asarray(r.history_evaluations).tolist(), cost=_listed(r.history_cost)),
        extra={
            k: v
            for k, v in r.extra.items()
            if isinstance(v, str | int | float | list) and k not in ("searched", "elsewhere", "nearly")
        },
    )


def _basins(problem: Problem, runs: Sequence[RunResult]) -> list[Basin]:
    finite = [r for r in runs if np.isfinite(r.cost)]
    if not finite:
        return []
    found = basins(np.array([r.cost for r in finite]), np.array([r.x for r in finite]), SAME, rounding(problem))
    return [
        Basin(cost=float(b.cost), runs=len(b.members), share=float(b.share), parameters=named(problem, b.x))
        for b in found
    ]


def _simulation(
    problem: Problem, z: np.ndarray, values: np.ndarray, verify: bool, scores: Sequence[Score]
) -> Simulation:
    moving = [n for n, d in problem.data["drive"].items() if isinstance(d, Drive)]
    if not problem.predictor.has_steps or not moving:
        return Simulation(stepper="none (static model)", substeps=0, outputs={})
    simulator = problem.predictor.stepping()
    name = least_exact(problem, z)[0]
    p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
    error = error_of(problem, z, name, CHECKED) if verify else by_doubling(simulator, p, problem.data["drive"][name])
    drive, rows = problem.data["drive"][name], {}
    for output in problem.outputs:
        index, y = problem.data["index"][name][output], problem.data["measured"][name][output]
        if not len(y) or not np.isfinite(error.max_error[output]):
            continue
        residual = problem.predict(values, name)[output][index] - y
        rows[output] = SimulatedOutput(
            unit=_unit(problem, output),
            max_error=error.max_error[output],
            rms_error=error.rms_error[output],
            rms_residual=float(np.sqrt(np.mean(residual**2))),
        )
    bad = {s.recording for s in scores if s.part == "fit" and s.fit_percent is not None and s.fit_percent < GOOD}
    forgets = [f for f in forgetting_of_lost(problem, z) if f.recording in bad] if bad else []
    return Simulation(
        stepper=simulator.stepper,
        substeps=problem.steps_a_sample,
        recording=name,
        checked_with=error.checked_with,
        checked_samples=error.last + 1,
        samples=len(drive.t) if drive.samples is None else len(drive.samples),
        checked_evaluations=CHECKED if error.spent else None,
        outputs=rows,
        forgets=[Forgets(recording=f.recording, growth=f.growth, tenfold=f.tenfold) for f in forgets],
        **({} if error.stopped is None else {"refused": error.stopped.sentence}),
    )
