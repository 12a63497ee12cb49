"""A study of 3000 runs (1000 each of PSO, genetic algorithm, salp swarm) on the torque of a two-link arm: run, stored,
compared, reported.

python -m benchmarks.thousand_runs [--workers 2] [--runs 1000] [--out FOLDER]
"""

import argparse
import tempfile
import time
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks import data
from benchmarks.torque import ITERATIONS, METHODS, PARTICLES, base
from plantfit.optimize import Objective
from plantfit.problem.evaluate.compress import compress, mean_square
from plantfit.report import write_comparison
from plantfit.study import Plan, Store, begin, helping, resume
from plantfit.study.comparing.gathering import gather
from plantfit.study.comparing.record import compared

NAMES = ("m1", "lc1", "I1", "m2", "lc2", "I2")


@cache
def problem():
    """The objective, the map to kg, m and kg m^2, and the cost of linear least squares, which no run can undercut."""
    task = data.torque()
    low, high = np.asarray(task.lower), np.asarray(task.upper)
    compressed = compress(task.regressor, task.torque)

    def physical(z):
        return low + z * (high - low)

    least = np.linalg.lstsq(task.regressor, task.torque)[0]
    objective = Objective(
        dimension=6, costs=lambda z: mean_square(compressed, base(physical(z))), lower=low, upper=high
    )
    return objective, physical, float(mean_square(compressed, least))


def make(text, path, files, start):
    """The problem again, in a process that helps."""
    return problem()[:2]


def main() -> None:
    parser = argparse.ArgumentParser(description="3000 runs on a torque regression")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    folder = chosen.out or Path(tempfile.mkdtemp(prefix="plantfit-"))
    folder.mkdir(parents=True, exist_ok=True)
    settings = {m: {"population": PARTICLES} for m in METHODS}
    plan = Plan(
        "torque",
        METHODS,
        runs=chosen.runs,
        budget=PARTICLES * ITERATIONS,
        seed=1,
        settings=settings,
        chunk=min(100, chosen.runs),
    )
    marks = [("begin", time.perf_counter())]
    objective, physical, floor = problem()
    store = Store.open(folder / "torque.db")
    study = begin(plan, objective, store, spec_text="torque", coordinates=NAMES, to_physical=physical)
    with helping(store, [study], chosen.workers - 1, maker="benchmarks.thousand_runs:make", say=print):
        resume(store, study, objective, to_physical=physical)
    marks.append(("search and store", time.perf_counter()))
    record = compared(gather(store, [study], floor=floor), seed=0)
    marks.append(("compare", time.perf_counter()))
    page = write_comparison(record, folder / "torque.html")
    marks.append(("report", time.perf_counter()))
    for (_, earlier), (name, later) in pairwise(marks):
        print(f"{name:18}{later - earlier:8.1f} s")
    size = sum(p.stat().st_size for p in folder.glob("torque.db*")) / 1e6
    print(f"{'in all':18}{marks[-1][1] - marks[0][1]:8.1f} s, {len(store.runs(study))} runs, {chosen.workers} workers")
    print(f"store {size:.1f} MB, report {Path(page).stat().st_size / 1e6:.1f} MB: {page}")
    for s in record.problems[0].sentences:
        print(f"- {s.sentence}")


if __name__ == "__main__":
    main()
