"""`plantfit check`: what was understood, and one simulation."""

import time

import numpy as np

from plantfit.cli.out import out, print_json


def check(spec: str, verify: bool, json: bool) -> None:
    """Read a study file, simulate at the middle of the box, optionally compare with a tight solver."""
    from plantfit import spec as specs
    from plantfit.models import describe
    from plantfit.problem.steps import choose_substeps

    study = specs.load(spec)
    problem = choose_substeps(study.problem)
    z = np.full(problem.space.dimension, 0.5)
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
    if verify:
        record["verify"] = _verify(problem, z)
    if json:
        return print_json(record)
    out.print(describe(problem.model), markup=False)
    for n, r in record["recordings"].items():
        out.print(
            f"recording {n}: {r['samples']} samples over {r['seconds']:g} s, {r['fitted']} fitted, {r['unseen']} unseen", markup=False
        )
        for line in r["log"]:
            out.print(f"    {line}", markup=False, style="dim")
    out.print(f"free: {', '.join(record['parameters'])}", markup=False)
    at = f"RMSE (scaled) {record['rmse_at_middle']:.4g}" if record["rmse_at_middle"] is not None else "not finite"
    out.print(
        f"at the middle of the bounds: {at}; {1e3 * seconds:.2g} ms an evaluation, {record['substeps']} step(s) a sample", markup=False
    )
    for name, e in record.get("verify", {}).items():
        out.print(
            f"against the tight solver: {name} within {e['max_error']:.3g} (rms {e['rms_error']:.3g}) over {e['samples']} samples",
            markup=False,
        )
    out.print(f"ready: plantfit run {spec}", markup=False)


def _verify(problem, z):
    from plantfit.simulate.verify import against_radau

    simulator = problem.predictor.stepping()
    values = problem.space.physical(z)
    name = next(iter(problem.data["drive"]))
    error = against_radau(simulator, problem.space.tree(values, name), problem.data["drive"][name])
    return {
        o: {"max_error": error.max_error[o], "rms_error": error.rms_error[o], "samples": error.last - error.first + 1}
        for o in problem.outputs
    }
