"""What an answer is worth: one plain record from a problem and the runs that were made on it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import RunResult
from plantfit.problem.accuracy.verification import followed, least_exact
from plantfit.problem.problem import Problem
from plantfit.simulate.check.verify import by_doubling, check_steps
from plantfit.simulate.simulator import Drive
from plantfit.study.comparing.basins import basins
from plantfit.study.versions import cpu_model, versions
from plantfit.trust.finish.agreement import SAME, agreement, opened
from plantfit.trust.finish.final_problem import CHECKED, rounding
from plantfit.trust.finish.smoothing_strength import smoothing_rows
from plantfit.trust.finish.weights import weight_rows
from plantfit.trust.identify.determined import determined_findings
from plantfit.trust.identify.table_visits import agreeing, table_visits
from plantfit.trust.intervals.following import followed_ranges
from plantfit.trust.intervals.linearised import EDGE as EDGE
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.parameter_rows import NOT_VISITED, parameter_rows, table_rows
from plantfit.trust.looks import problem_looks
from plantfit.trust.stated_errors.findings import uncertainty_findings
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.validate.residual_tests import cross_correlation, independent, measured_rows, whiteness
from plantfit.trust.verdict.all_sentences import sentences
from plantfit.trust.verdict.fit import ROUNDING


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
    """The findings record (docs/architecture.md) for the best of `runs`; JSON types only.

    Shared `errors` widen the intervals (section "uncertainty"): to first order, or by so many `draws`.
    """
    best = min(runs, key=lambda r: r.cost)
    local = linearise(problem, best.x)
    predictions = {name: problem.predict(local.values, name) for name in problem.experiments}
    visits, unseen = agreeing(table_visits(problem, local.values), dict(zip(problem.space.names, local.touched.tolist(), strict=True)))
    ranges = None
    if local.linear is not None:
        ranges = followed_ranges(problem, best.x, local.linear, sum(r.evaluations for r in runs))
    rows = parameter_rows(problem.space, local, unseen, ranges)
    agreed = agreement(problem, runs)
    rows = opened(rows, agreed["ranges"])
    rows, uncertainty = uncertainty_findings(problem, best.x, rows, errors, draws, seed)
    findings = {
        "name": problem.name,
        "recordings": [_recording(problem, n, predictions[n]) for n in problem.experiments],
        "scores": _scores(problem, predictions),
        "residual_tests": _residual_tests(problem, predictions),
        "data": [look.record for look in problem_looks(problem)],
        "diagnosis": None,
        "parameters": rows,
        "uncertainty": uncertainty,
        "standard_errors": {"kind": "robust" if local.robust else "classical", "in_time": problem.in_time},
        "tables": table_rows(problem, rows, visits),
        "smoothing": smoothing_rows(problem, local),
        "combinations": _combinations(local, rows),
        "determined": determined_findings(problem, local.linear, rows, ranges or {}),
        "runs": [_run(problem, r) for r in runs],
        "basins": _basins(problem, runs),
        "agreement": agreed,
        "weights": weight_rows(problem),
        "simulation": _simulation(problem, best.x, local.values, verify),
        "reproduction": {
            "spec": spec,
            "seed": seed,
            "versions": versions(),
            "cpu": cpu_model(),
            "seconds": dict(seconds or {}),
            "command": command,
        },
    }
    findings["verdict"] = sentences(findings, best)
    return findings


def _parts(problem: Problem, name: str):
    experiment = problem.experiments[name]
    return {"fit": experiment.mask("fit"), "validation": experiment.mask("validation")}


def _recording(problem, name, predicted):
    record = problem.experiments[name].recording
    masks = _parts(problem, name)
    part = np.where(masks["fit"], "fit", np.where(masks["validation"], "validation", ""))
    inputs = getattr(problem.model, "inputs", None) or getattr(problem.model, "signals", {})
    return {
        "name": name,
        "log": list(record.log),
        "t": record.t.tolist(),
        "inputs": {n: {"unit": record.signals[n].unit, "values": _listed(record[n])} for n in inputs if n not in problem.outputs},
        "outputs": {
            o: {
                "unit": _unit(problem, o),
                "measured": _listed(record[o]),
                "simulated": _listed(predicted[o]),
                "part": part.tolist(),
            }
            for o in problem.outputs
        },
    }


def _unit(problem, output):
    for experiment in problem.experiments.values():
        if experiment.recording.signals[output].unit:
            return problem.model.outputs[output] or experiment.recording.signals[output].unit
    return problem.model.outputs[output]


def _listed(values):
    return [float(v) if np.isfinite(v) else None for v in np.asarray(values)]


def _scores(problem, predictions):
    result = []
    for name, experiment in problem.experiments.items():
        for output in problem.outputs:
            y, fit = experiment.recording[output], predictions[name][output]
            for part, mask in _parts(problem, name).items():
                use = mask & np.isfinite(y)
                if use.sum() < 2:
                    continue
                error = fit[use] - y[use]
                spread = np.linalg.norm(y[use] - y[use].mean())
                result.append(
                    {
                        "recording": name,
                        "output": output,
                        "unit": _unit(problem, output),
                        "part": part,
                        "n": int(use.sum()),
                        "rmse": float(np.sqrt(np.mean(error**2))),
                        "bias": float(error.mean()),
                        "fit_percent": float(100 * (1 - np.linalg.norm(error) / spread)) if spread > 0 else None,
                    }
                )
    return result


def _residual_tests(problem, predictions):
    result = []
    inputs = getattr(problem.model, "inputs", {})
    for name, experiment in problem.experiments.items():
        record, mask = experiment.recording, experiment.mask("fit")
        if mask.sum() < 20:
            continue
        for output in problem.outputs:
            residual = np.where(mask, record[output] - predictions[name][output], np.nan)[mask]
            if not np.any(np.isfinite(residual)) or np.nanstd(residual) <= ROUNDING * np.nanmax(np.abs(record[output])):
                continue
            rows = measured_rows(residual)
            residual, period = residual[rows], float(np.median(np.diff(record.t[mask][rows])))
            own, p_value = whiteness(residual)
            cross = {}
            for i in inputs:
                u = record[i][mask][rows]
                if np.std(u) == 0:
                    continue
                c = cross_correlation(residual, u)
                cross[i] = {
                    "lags_s": (c.lags * period).tolist(),
                    "values": c.values.tolist(),
                    "bound": c.bound,
                    "independent": independent(c),
                }
            result.append(
                {
                    "recording": name,
                    "output": output,
                    "lags_s": (own.lags * period).tolist(),
                    "autocorrelation": own.values.tolist(),
                    "bound": own.bound,
                    "white": bool(p_value > 0.01),
                    "p_value": p_value,
                    "shared": experiment.shared_errors.get(output),
                    "cross": cross,
                }
            )
    return result


def _combinations(local: Local, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """All directions, the worst first; one of a single parameter only when its row does not say so already."""
    told = {row["name"] for row in rows if row["status"] in ("flat", "at bound", NOT_VISITED)}
    unseen = {row["name"] for row in rows if row["status"] == NOT_VISITED}
    kept = [d for d in local.directions if not (told if len(d.weights) == 1 else unseen).issuperset(d.weights)]
    kept.sort(key=lambda d: (len(d.weights) == 1, -d.relative_sd))
    return [{"sentence": d.sentence if local.linear is None else d.moves, "weights": d.weights, "relative_sd": d.relative_sd} for d in kept]


def _run(problem, r):
    values = np.asarray(problem.space.physical(r.x))
    one = len(problem.outputs) == 1
    squares = r.cost if problem.smoothing is None else float(problem.unsmoothed.costs(r.x[None, :])[0])
    return {
        "method": r.method,
        "run": r.run,
        "seed": r.seed,
        "cost": float(r.cost) if np.isfinite(r.cost) else None,
        "rmse": float(np.sqrt(squares)) * (problem.scales[problem.outputs[0]] if one else 1.0) if np.isfinite(r.cost) else None,
        "status": str(r.status),
        "ended": str(r.extra.get("ended", "")),
        "evaluations": float(r.evaluations),
        "seconds": float(r.seconds),
        "failures": int(r.failures),
        "parameters": dict(zip(problem.space.names, values.tolist(), strict=True)),
        "searched": _named(problem, r.extra["searched"]) if "searched" in r.extra else {},
        "history": {"evaluations": np.asarray(r.history_evaluations).tolist(), "cost": _listed(r.history_cost)},
        "extra": {k: v for k, v in r.extra.items() if isinstance(v, str | int | float | list) and k not in ("searched", "elsewhere")},
    }


def _named(problem, z):
    return dict(zip(problem.space.names, np.asarray(problem.space.physical(np.asarray(z))).tolist(), strict=True))


def _basins(problem, runs):
    finite = [r for r in runs if np.isfinite(r.cost)]
    if not finite:
        return []
    found = basins(np.array([r.cost for r in finite]), np.array([r.x for r in finite]), SAME, rounding(problem))
    return [
        {
            "cost": float(b.cost),
            "runs": len(b.members),
            "share": float(b.share),
            "parameters": dict(zip(problem.space.names, np.asarray(problem.space.physical(b.x)).tolist(), strict=True)),
        }
        for b in found
    ]


def _simulation(problem, z, values, verify):
    moving = [n for n, d in problem.data["drive"].items() if isinstance(d, Drive)]
    if not problem.predictor.has_steps or not moving:
        return {"stepper": "none (static model)", "substeps": 0, "outputs": {}}
    simulator = problem.predictor.stepping()
    name = least_exact(problem, z)[0]
    p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
    drive = problem.data["drive"][name]
    error = check_steps(simulator, p, drive, tight=followed(problem, z, name, CHECKED)) if verify else by_doubling(simulator, p, drive)
    rows = {}
    for output in problem.outputs:
        index, y = problem.data["index"][name][output], problem.data["measured"][name][output]
        if not len(y) or not np.isfinite(error.max_error[output]):
            continue
        residual = problem.predict(values, name)[output][index] - y
        rows[output] = {
            "unit": _unit(problem, output),
            "max_error": error.max_error[output],
            "rms_error": error.rms_error[output],
            "rms_residual": float(np.sqrt(np.mean(residual**2))),
        }
    return {
        "stepper": simulator.stepper,
        "substeps": problem.steps_a_sample,
        "recording": name,
        "checked_with": error.checked_with,
        "checked_samples": error.last + 1,
        "samples": len(drive.t) if drive.samples is None else len(drive.samples),
        "outputs": rows,
        **({} if error.stopped is None else {"refused": error.stopped.sentence}),
    }
