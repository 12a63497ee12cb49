"""Reference implementations on workload S: starts of benchmarks/bbob/references.py on the 310-parameter box, costs by
our engine.

A reference sees the box [-5, 5]^310. Where it asks for one candidate at a time, its runs go side by side in threads and
are answered together, so that the time left over is its own.
"""

import importlib.metadata
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bbob.pyhms_rival import interpreter
from benchmarks.bbob.references import CMA_QUIET, REFERENCES, WIDTH, Reference, minion, run_reference
from benchmarks.bbob.suite import LOWER, Done, Problem, Run, seed_of

Costs = Callable[[np.ndarray], np.ndarray]  # cube points (n, d) to (n,)
ROOT = Path(__file__).resolve().parents[2]
# have generators of their own, so that threads change nothing
ONE_BY_ONE = ("dish-python", "dish-python-repaired", "mealpy-sso")
PYHMS = {"pyhms": False, "pyhms-repaired": True}
PYHMS_RUNS = 3
SAME_POPULATION = {"population_size": 100, "x_tol": 0.0}  # what our L-SHADE and jSO begin with in 310-D

BOX: dict[str, Reference] = {
    **{name: REFERENCES[name] for name in ("numpy-random", "pymoo-pso", "pymoo-ga", "pymoo-de", "pymoo-de-published")},
    **{name: REFERENCES[name] for name in ("mealpy-sso", "minion-pso", "minion-shade")},
    "minion-lshade": Reference(
        partial(minion, name="LSHADE", options=lambda d: SAME_POPULATION), "minionpy", "N0 = 100 as ours, x_tol 0"
    ),
    "minion-jso": Reference(
        partial(minion, name="jSO", options=lambda d: SAME_POPULATION), "minionpy", "N0 = 100 as ours, x_tol 0"
    ),
    "minion-lshade-default": Reference(
        partial(minion, name="LSHADE", options=lambda d: {"x_tol": 0.0}), "minionpy", "its default N0"
    ),
    "minion-jso-default": Reference(
        partial(minion, name="jSO", options=lambda d: {"x_tol": 0.0}), "minionpy", "its default N0"
    ),
    **{name: REFERENCES[name] for name in ("dish-python", "dish-python-repaired", "pycma-sep", "pycma")},
}
"""Cheapest first."""


@dataclass
class SteamRun(Run):
    """A run whose candidates are evaluated in batches. `best_z` (d,) is its best cube point; `outside` is the
    processor time that its thread spent on costs."""

    evaluate: Costs = field(default=np.asarray)
    best_z: np.ndarray = field(default_factory=lambda: np.zeros(0))
    outside: float = 0.0

    def costs(self, x: Any) -> np.ndarray:
        x = np.ascontiguousarray(x, dtype=float)
        if self.done:
            raise Done
        here = x[: self.remaining]
        began = time.thread_time()
        z = np.clip((here - LOWER) / WIDTH, 0.0, 1.0)
        f = self.evaluate(z)
        self.outside += time.thread_time() - began
        if np.min(f) < self.best:
            self.best_z = z[np.argmin(f)]
        self._record(f)
        if len(here) < len(x):
            raise Done
        return f


def new_run(evaluate: Costs, dimension: int, budget: int, number: int) -> SteamRun:
    """Run `number`, on a function 0 that BBOB does not have."""

    def one(x: Any) -> float:
        return float(evaluate((np.asarray(x, dtype=float)[None] - LOWER) / WIDTH)[0])

    return SteamRun(Problem(0, dimension, number, 0.0, one), budget, evaluate=evaluate)


class Meeting:
    """Evaluates together what several threads ask for: each waits until all that are still searching have asked."""

    def __init__(self, evaluate: Costs, members: int):
        self._evaluate, self._active = evaluate, members
        self._asked: dict[int, np.ndarray] = {}
        self._answers: dict[int, Any] = {}
        self._changed = threading.Condition()

    def ask(self, member: int, z: np.ndarray) -> np.ndarray:
        with self._changed:
            self._asked[member] = z
            self._serve()
            self._changed.wait_for(lambda: member in self._answers)
            answer = self._answers.pop(member)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def leave(self) -> None:
        with self._changed:
            self._active -= 1
            self._serve()

    def _serve(self) -> None:
        if not self._asked or len(self._asked) < self._active:
            return
        members = list(self._asked)
        try:
            f = self._evaluate(np.concatenate([self._asked[m] for m in members]))
            ends = np.cumsum([len(self._asked[m]) for m in members])
            self._answers |= dict(zip(members, np.split(f, ends[:-1]), strict=True))
        except Exception as error:  # every thread that waits must hear of it
            self._answers |= dict.fromkeys(members, error)
        self._asked.clear()
        self._changed.notify_all()


def run_one_after_another(reference: Reference, runs: list[SteamRun], seed: int) -> float:
    """All runs; processor seconds of the reference alone."""
    seconds = 0.0
    for run in runs:
        began = time.thread_time()
        run_reference(reference, [run], seed)
        seconds += time.thread_time() - began - run.outside
    return seconds


def run_side_by_side(reference: Reference, runs: list[SteamRun], seed: int) -> float:
    """As `run_one_after_another`, in threads."""
    meeting = Meeting(runs[0].evaluate, len(runs))
    seconds, errors = [0.0] * len(runs), []

    def search(k: int, run: SteamRun) -> None:
        run.evaluate = lambda z: meeting.ask(k, z)
        try:
            run_reference(reference, [run], seed)
        except Exception as error:
            errors.append(error)
        finally:
            meeting.leave()
        seconds[k] = time.thread_time() - run.outside

    threads = [threading.Thread(target=search, args=(k, run)) for k, run in enumerate(runs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
    return sum(seconds)


def run_pyhms(runs: list[SteamRun], seed: int, *, repaired: bool) -> float:
    """pyhms in its own environment, a subprocess for each run; its processor seconds. Raises Missing without the
    environment."""
    python, seconds = interpreter(), 0.0
    for run in runs:
        one = seed_of(seed, run.problem.function, run.dimension, run.problem.instance)
        command = [
            str(python),
            "-m",
            "benchmarks.steam.pyhms_worker",
            str(one),
            str(int(repaired)),
            str(run.budget),
            str(run.dimension),
        ]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as worker:
            assert worker.stdin is not None
            assert worker.stdout is not None
            while True:
                head = worker.stdout.read(8)
                if len(head) < 8:
                    raise RuntimeError(f"pyhms ({python}) ended without an answer; what it printed is above.")
                count = struct.unpack("q", head)[0]
                if count < 0:
                    seconds += struct.unpack("d", worker.stdout.read(8))[0]
                    break
                x = np.frombuffer(worker.stdout.read(8 * count * run.dimension)).reshape(count, run.dimension)
                worker.stdin.write(np.ascontiguousarray(run.costs(x)).tobytes())
                worker.stdin.flush()
    return seconds


def pycma_from(z: np.ndarray, sigma: float) -> Reference:
    """pycma with its mean at the cube point z and a first step of `sigma` ranges."""

    def start(run: Run, seed: int) -> None:
        import cma

        es = cma.CMAEvolutionStrategy(LOWER + WIDTH * z, sigma * WIDTH, {**CMA_QUIET, "seed": seed + 1})
        while not es.stop():
            x = es.ask()
            es.tell(x, run.costs(np.array(x)).tolist())

    return Reference(start, "cma", f"from the static solution, sigma0 = {sigma:g} ranges")


def about(reference: Reference) -> str:
    """Package, version and settings."""
    return f"{reference.package} {importlib.metadata.version(reference.package)}: {reference.settings}"
