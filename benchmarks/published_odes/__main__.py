"""`python -m benchmarks.published_odes [NAME...] --seeds 10`: published problems as a user would fit them, judged by
other solvers.

For each study file: the simulation at the published parameters against a tight solver and against the published
simulation, as a share of each output's range; then fits with default settings, and whether any reports a cost below
that of the tight solver by more than 1 %. With `--json FILE` what stands in the file already is not computed again, so
that a study of hours can be stopped and taken up.
"""

import argparse
import csv
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

STUDIES = Path(__file__).parent / "studies"
NAMES = ("boehm", "bruno", "crauste", "elowitz", "perelson", "sneyd")


def published(name: str) -> dict[str, float]:
    """The published parameters, which stand behind each table of the study file."""
    found, own = {}, ""
    for line in (STUDIES / f"{name}.toml").read_text(encoding="utf-8").splitlines():
        if line.startswith("[parameters."):
            own = line.removeprefix("[parameters.").removesuffix("]")
        if line.startswith("# published: "):
            found[own] = float(line.removeprefix("# published: "))
    return found


def simulated(name: str, recording: str, outputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The published simulation, NaN where there is none."""
    with (STUDIES / f"{name}_{recording}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {o: np.array([float(r.get(f"p_{o.removeprefix('y_')}") or "nan") for r in rows]) for o in outputs}


def at_published(name: str) -> dict[str, Any]:
    """Largest errors at the published parameters, as shares of the outputs' ranges."""
    from plantfit import spec
    from plantfit.problem.accuracy.steps import choose_substeps, steps_for
    from plantfit.problem.accuracy.verification import followed

    problem = spec.load(str(STUDIES / f"{name}.toml")).problem
    values = problem.space.vector(published(name))
    z = np.asarray(problem.space.cube(values))
    prepared = choose_substeps(problem)
    shown = steps_for(prepared, z)
    worst = {"default": 0.0, "at the values": 0.0, "published": 0.0, "published and tight": 0.0}
    for recording in problem.experiments:
        tight = followed(shown, z, recording, 10_000_000)
        ours = {"default": prepared.predict(values, recording), "at the values": shown.predict(values, recording)}
        told = simulated(name, recording, problem.outputs)
        for o in problem.outputs:
            exact = tight.outputs[o]
            seen = np.isfinite(told[o])
            width = max(float(np.ptp(exact)), 1e-12)
            for key, y in ours.items():
                off = float(np.max(np.abs(y[o] - exact))) / width
                worst[key] = max(worst[key], off if np.isfinite(off) else np.inf)
            if np.any(seen):
                worst["published"] = max(
                    worst["published"], float(np.max(np.abs(ours["at the values"][o] - told[o])[seen])) / width
                )
                worst["published and tight"] = max(
                    worst["published and tight"], float(np.max(np.abs(exact - told[o])[seen])) / width
                )
    return {"name": name, "steps": shown.steps_a_sample, "cost": float(shown.cost(z)), **worst}


def fitted(name: str, seed: int) -> dict[str, Any]:
    """One fit with default settings from no start; its cost beside those of the tight solver, whole records, there
    and at the published parameters: a search among false costs would end above these."""
    from plantfit import fit, spec
    from plantfit.problem.accuracy.verification import checked_cost

    began, spent = time.perf_counter(), time.process_time()
    answer = fit(spec.load(str(STUDIES / f"{name}.toml")).problem, seed=seed)
    seconds, processor = time.perf_counter() - began, time.process_time() - spent
    told = checked_cost(answer.problem, answer.best.x, evaluations=10_000_000)
    space = answer.problem.space
    known = checked_cost(answer.problem, np.asarray(space.cube(space.vector(published(name)))), evaluations=10_000_000)
    return {
        "seed": seed,
        "cost": float(answer.best.cost),
        "tight": told.cost_checked,
        "below": 1.0 - float(answer.best.cost) / told.cost_checked if np.isfinite(told.cost_checked) else None,
        "refused": "refused" in answer.best.extra,
        "status": str(answer.best.status),
        "over published": told.cost_checked / known.cost_checked,
        "seconds": seconds,
        "seconds of CPU": processor,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(NAMES))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--json", type=Path, default=None, help="where the results are kept")
    options = parser.parse_args()
    kept = json.loads(options.json.read_text()) if options.json and options.json.exists() else []
    rows = {row["name"]: row for row in kept}

    def keep() -> None:
        if options.json:
            options.json.write_text(json.dumps(list(rows.values()), indent=1))

    for name in options.names:
        row = rows.get(name) or {**at_published(name), "fits": []}
        rows[name] = row
        keep()
        print(
            f"{name}: at the published parameters {row['steps']:g} steps a sample; error as a share of the range: "
            f"default steps {row['default']:.1e}, steps for these values {row['at the values']:.1e}; against the "
            f"published simulation {row['published']:.1e} (tight solver {row['published and tight']:.1e})",
            flush=True,
        )
        for seed in range(options.seeds):
            one = next((f for f in row["fits"] if f["seed"] == seed), None)
            if one is None:
                one = fitted(name, seed)
                row["fits"].append(one)
                keep()
            below = "refused" if one["below"] is None else f"{100 * one['below']:+.3f} % below the tight solver's"
            word = " (said to be refused)" if one["refused"] else ""
            print(
                f"  seed {seed}: cost {one['cost']:.6g}, {below}{word}, {one['status']}, "
                f"{one['over published']:.4g} times the published cost, {one['seconds of CPU']:.0f} s of CPU",
                flush=True,
            )


if __name__ == "__main__":
    main()
