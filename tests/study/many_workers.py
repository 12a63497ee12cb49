"""Run as a script by test_concurrent_stores.py: several processes that claim and finish tasks as fast as they can.

python many_workers.py ADDRESS PROCESSES RUNS share    all on study 1
python many_workers.py ADDRESS PROCESSES RUNS own      each on a study of its own
Prints one line per finished task: study, method, first run.
"""

import os
import sys
import traceback

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.contract import RunResult
from plantfit.study import Plan, Store
from plantfit.study.running.worker_names import new_worker

NAMES = ("a", "b", "c")


def plan(name: str, runs: int) -> Plan:
    return Plan(name=name, methods=("random", "pso"), runs=runs, budget=20, seed=4, chunk=2)


def result(method: str, run: int) -> RunResult:
    """Numbers of the method and the run; jax would take seconds in each process."""
    x = np.array([len(method), run, 1 / (1 + run)])
    return RunResult(
        method, run, 4, x, float(x.sum()), 20.0, 0.1, Status.budget, np.arange(1.0, 21.0), x.sum() / np.arange(1, 21)
    )


def work(address: str, runs: int, own: bool) -> None:
    store, me = Store.open(address), new_worker()
    study_id = store.add(plan(f"of {os.getpid()}", runs), spec_text=None, coordinates=NAMES, probe=b"") if own else 1
    said = []
    while (claim := store.claim(study_id, me)) is not None:
        task = claim.task
        store.beat(claim, 1.0)
        store.save_checkpoint(claim, b"on the way")
        results = [result(task.method, task.first + k) for k in range(task.count)]
        store.finish(claim, results, [dict(zip(NAMES, r.x.tolist(), strict=True)) for r in results])
        store.settle(study_id, active=True)
        store.add_note(study_id, f"{task.method} {task.first} by {os.getpid()}")
        said.append(f"{study_id} {task.method} {task.first}\n")
    os.write(1, "".join(said).encode())  # one write of a process is not torn apart


def main(address: str, processes: str, runs: str, what: str) -> int:
    children = []
    for _ in range(int(processes)):
        child = os.fork()  # before any connection is open
        if child == 0:
            code = 1
            try:
                work(address, int(runs), what == "own")
                code = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)
        children.append(child)
    return max(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
