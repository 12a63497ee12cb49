"""`plantfit check`: what was understood, and one simulation."""

import dataclasses
import time
from collections.abc import Iterable, Sequence

import numpy as np

from plantfit.cli.assignments import numbers_by_name
from plantfit.cli.out import out, print_json


def check(spec: str, verify: bool, json: bool, at: Sequence[str] = (), tolerance: float | None = None) -> None:
    """Read a study file, simulate at the middle of the box or at the values given, optionally compare with a tight solver."""
    from plantfit import spec as specs
    from plantfit.models import describe
    from plantfit.problem.steps import choose_substeps
    from plantfit.problem.verification import point

    study = specs.load(spec)
    problem = choose_substeps(study.problem)
    z = point(problem, numbers_by_name("--at", at))
    cost = float(problem.costs(z[None, :])[0])
    started = time.perf_counter()
    np.asarray(problem.costs(z[None, :]))
    seconds = time.perf_counter() - started
    simulator = problem.predictor.simulator
    record = {
        "name": study.name,
        "model": problem.model.name,
        "recordings": {
            n: {
                "samples": len(e.recording),
                "seconds": float(e.recording.t[-1] - e.recording.t[0]),
                "fitted": int(e.mask("fit").sum()),
                "unseen": int(e.mask("validation").sum()),
                "log": list(e.recording.log),
            }
            for n, e in problem.experiments.items()
        },
        "parameters": {
            c.name: {"bounds": [c.lower, c.upper], "unit": c.unit, "scale": "log" if c.log else "linear"} for c in problem.space.coordinates
        },
        "substeps": simulator.substeps if simulator else 0,
        "rmse_at_middle": cost**0.5 if np.isfinite(cost) else None,
        "seconds_per_evaluation": seconds,
        "evaluations": study.plan.budget * study.plan.runs * len(study.plan.methods),
    }
    if study.errors:
        from plantfit.trust.reading_budgets import reading_budgets

        record["uncertainty"] = reading_budgets(problem, study.errors)
    if verify:
        record["verify"] = _verify(problem, z, tolerance)
    if json:
        return print_json(record)
    out.print(describe(problem.model), markup=False)
    for n, r in record["recordings"].items():
        out.print(
            f"recording {n}: {r['samples']} samples over {r['seconds']:g} s, {r['fitted']} fitted, {r['unseen']} unseen", markup=False
        )
        for line in r["log"]:
            out.print(f"    {line}", markup=False, style="dim")
    out.print(f"free: {_shortened(record['parameters'])}", markup=False)
    rmse = f"RMSE (scaled) {record['rmse_at_middle']:.4g}" if record["rmse_at_middle"] is not None else "not finite"
    place = f"at {', '.join(at)}" if at else "at the middle of the bounds"
    out.print(f"{place}: {rmse}; {1e3 * seconds:.2g} ms an evaluation, {record['substeps']} step(s) a sample", markup=False)
    for e in record.get("verify", []):
        unit = problem.model.outputs[e["output"]] or ""
        out.print(
            f"against {e['checked_with']}: {e['recording']}, {e['output']} within {e['max_error']:.3g} {unit} (rms {e['rms_error']:.3g}) "
            f"over {e['samples']} samples, {e['substeps']} step(s) a sample",
            markup=False,
        )
        if tolerance is not None and e["max_error"] >= tolerance:
            out.print(f"    not below {tolerance:g}: the model is too stiff or too rough here for finer steps to help", style="yellow")
    if study.errors:
        from plantfit.report import budgets_text

        out.print(f"\nstated errors:\n\n{budgets_text(record['uncertainty'])}\n", markup=False)
    out.print(f"ready: plantfit run {spec}", markup=False)


def _shortened(names: Iterable[str], most: int = 12) -> str:
    names = list(names)
    return ", ".join(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"


def _verify(problem, z, tolerance):
    from plantfit.problem.verification import verify

    return [dataclasses.asdict(v) for v in verify(problem, z, tolerance)]
