"""Runs pyhms in a Python of its own (numpy < 2): `python -m benchmarks.bbob.pyhms_worker TASK.json OUT.npz`; see
pyhms_rival."""

import importlib
import json
import sys
import time
import warnings
from typing import Any

import numpy as np

from benchmarks.bbob.suite import LOWER, UPPER, Done, Problem, Run, coco_suite


def start(run: Run, seed: int, repaired: bool) -> None:
    """One tree of demes on the unit cube: `pyhms.minimize`, or the same with a sprout condition that lets leaves
    sprout."""
    # `from pyhms import hms` gives a function of that name
    hms: Any = importlib.import_module("pyhms.hms")
    if repaired:
        # the demes that have stopped no longer block the place they stopped at, and seeds may lie closer
        hms.get_NBC_sprout = lambda: _sprout()
    hms.minimize(
        lambda z: run(LOWER + (UPPER - LOWER) * np.asarray(z)),
        bounds=np.array([(0.0, 1.0)] * run.dimension),
        maxfun=run.remaining,
        seed=seed,
    )


def _sprout() -> Any:
    s: Any = importlib.import_module("pyhms.sprout")
    return s.SproutMechanism(
        s.NBC_Generator(3.0, 0.7), [s.NBC_FarEnough(2.0, 2, check_only_active=True), s.DemeLimit(1)], [s.LevelLimit(4)]
    )


def main() -> None:
    with open(sys.argv[1]) as file:
        task = json.load(file)
    warnings.simplefilter("ignore")
    began, runs = time.process_time(), []
    for instance, optimum, seed in zip(task["instances"], task["optima"], task["seeds"], strict=True):
        cost = coco_suite(task["dimension"]).get_problem_by_function_dimension_instance(
            task["function"], task["dimension"], instance
        )
        run = Run(
            Problem(task["function"], task["dimension"], instance, optimum, cost), task["budget"], keep=task["keep"]
        )
        for attempt in range(100):
            before = run.evaluations
            try:
                start(run, seed + attempt, task["repaired"])
            except Done:
                break
            if run.done or run.evaluations == before:
                break
        runs.append(run)
    arrays = {}
    for k, run in enumerate(runs):
        arrays |= {f"at{k}": np.array(run.at), f"above{k}": np.array(run.above)}
        if run.keep:
            arrays[f"points{k}"] = np.concatenate(run.points)
    np.savez(sys.argv[2], spent=[r.evaluations for r in runs], seconds=time.process_time() - began, **arrays)


if __name__ == "__main__":
    main()
