"""`python -m benchmarks.steam.portfolio --out FOLDER`: every method and its references on workload S, 310 parameters,
10 000 evaluations.

Two tasks: `box`, from anywhere in the box, and `static`, from the best four constants of each opening. Costs are ratios
to the noise floor, 0.025 bar^2. The noise and the seeds of the runs are not those that settings were chosen on.
Finished methods are kept in FOLDER and skipped the next time; `--table` only prints.
"""

import argparse
import dataclasses
import importlib.metadata
import os
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import mannwhitneyu

import plantfit.runtime  # noqa: F401
from benchmarks.bbob.pyhms_rival import Missing
from benchmarks.bbob.references import Reference
from benchmarks.steam import portfolio_rivals as rivals
from benchmarks.steam.ours import cube
from benchmarks.steam.weighted import FLOOR, WORKLOAD_SEED, record, static, weighted
from plantfit.optimize import minimise
from plantfit.optimize.contract import Facts, Objective
from plantfit.optimize.registry import make
from plantfit.study.objective import objective_of

import jax

RECORD_SEED, RUN_SEED = 5, 20265
RUNS, BUDGET = 10, 10_000
LANES, WIDE = 16, 64  # batches are filled up to a multiple of these
HOST_WARM_UP = 600  # evaluations that compile what a host method calls
FINER = 8  # steps a sample with which answers are checked
FEW = {"nelder_mead": 2}  # runs of what asks for one candidate at a time and is here as a baseline only
OURS = (
    "random", "sobol", "salp_swarm", "pso", "de", "shade", "lshade", "jso", "dish", "elite_ga", "binary_ga", "cga",
    "sea",
    "sep_cmaes", "dd_cmaes", "cmaes", "hms", "bipop_cmaes", "ipop_cmaes", "least_squares", "auto", "lbfgsb",
    "nelder_mead",
)  # fmt: skip
"""Cheapest first."""
OURS_LOCAL = ("least_squares", "lbfgsb", "sep_cmaes", "dd_cmaes", "cmaes")
DRAWLESS = ("least_squares", "lbfgsb")  # from a given start they go the same way whatever the seed
STEPS = (0.02, 0.05)  # first steps of pycma from the static solution
PAIRS: dict[str, tuple[str, ...]] = {
    "random": ("numpy-random",),
    "pso": ("pymoo-pso", "minion-pso"),
    "cga": ("pymoo-ga",),
    "elite_ga": ("pymoo-ga",),
    "sea": ("pymoo-ga",),
    "binary_ga": ("pymoo-ga",),
    "salp_swarm": ("mealpy-sso",),
    "de": ("pymoo-de", "pymoo-de-published"),
    "shade": ("minion-shade",),
    "lshade": ("minion-lshade", "minion-lshade-default"),
    "jso": ("minion-jso", "minion-jso-default"),
    "dish": ("dish-python", "dish-python-repaired"),
    "hms": ("pyhms", "pyhms-repaired"),
    "cmaes": ("pycma",),
    "sep_cmaes": ("pycma-sep", "pycma"),
    "dd_cmaes": ("pycma", "pycma-sep"),
}
PAIRS_LOCAL = {name: tuple(f"pycma-{step:g}" for step in STEPS) for name in ("cmaes", "sep_cmaes", "dd_cmaes")}


class Outcome(NamedTuple):
    """Final costs (runs,), the same with FINER steps a sample, evaluations (runs,), processor seconds of all runs,
    those of them spent outside our engine (NaN: not told apart) and what a reader has to know."""

    costs: np.ndarray
    finer: np.ndarray
    evaluations: np.ndarray
    seconds: float
    own: float
    note: str


class Bench:
    """The record with one draw of noise, compiled once."""

    def __init__(self, record_seed: int, seed: int):
        self.data, self.seed = record(record_seed), seed
        self.problem = weighted(self.data)
        self.objective = objective_of(self.problem)
        self._costs = jax.jit(self.objective.costs)

    def costs(self, z: np.ndarray) -> np.ndarray:
        """Costs (n,) of cube points (n, 310), in batches of two sizes so that two programs are enough."""
        size = LANES if len(z) <= 2 * LANES else WIDE
        pieces = [z[i : i + size] for i in range(0, len(z), size)]
        return np.concatenate([self._filled(piece, size if len(piece) > LANES else LANES) for piece in pieces])

    def _filled(self, z: np.ndarray, size: int) -> np.ndarray:
        full = np.concatenate([z, np.repeat(z[:1], size - len(z), axis=0)])
        return np.array(self._costs(full), dtype=float)[: len(z)]

    @cached_property
    def _finer(self) -> Callable:
        variant = self.problem.with_simulator(self.problem.predictor.stepping().refined(FINER))
        return jax.jit(variant.costs)

    def finer(self, z: np.ndarray) -> np.ndarray:
        """Costs (n,) of points with FINER steps a sample."""
        full = np.concatenate([z, np.repeat(z[:1], -len(z) % LANES, axis=0)])
        return np.concatenate([self._finer(piece) for piece in np.split(full, len(full) // LANES)])[: len(z)]

    @cached_property
    def truth(self) -> float:
        """Cost of the true parameters."""
        return float(self.costs(cube(self.problem, self.data.truth.reshape(1, -1)))[0])

    @cached_property
    def static(self) -> np.ndarray:
        z, found = static(self.problem, self.objective, self.seed)
        print(
            f"static solution: {found.cost / FLOOR:.3f} times the floor, {found.evaluations:.0f} evaluations",
            flush=True,
        )
        return z

    # -- ours ---------------------------------------------------------------------------------------

    def ours(self, name: str, objective: Objective, runs: int, budget: int) -> Outcome:
        """A method of plantfit, compiled beforehand by a short search."""
        method = make(name)
        if hasattr(method, "rows"):
            facts = Facts(objective.dimension, budget, objective.lower, objective.upper, objective.start)
            short, several = method.rows(facts), runs  # one generation; programs depend on the number of runs
        else:
            short, several = HOST_WARM_UP, 1
        minimise(objective, name, runs=several, budget=short, seed=self.seed + 1)
        began = time.process_time()
        results = minimise(objective, name, runs=runs, budget=budget, seed=self.seed)
        seconds = time.process_time() - began
        x = np.stack([r.x for r in results])
        return Outcome(
            np.array([r.cost for r in results]), self.finer(x), np.array([r.evaluations for r in results]), seconds,
            np.nan,
            f"plantfit {importlib.metadata.version('plantfit')}",
        )  # fmt: skip

    # -- references ---------------------------------------------------------------------------------

    def reference(self, reference: Reference, runs: int, budget: int, *, together: bool = False) -> Outcome:
        """A reference implementation; `together` runs it in threads, for those that ask for one candidate at a time."""
        drive = rivals.run_side_by_side if together else rivals.run_one_after_another
        return self._counted(
            lambda searches: drive(reference, searches, self.seed), runs, budget, rivals.about(reference)
        )

    def pyhms(self, repaired: bool, runs: int, budget: int) -> Outcome:
        """pyhms, whose own processor time is that of its process and comes on top. Raises Missing."""
        note = "pyhms 1.0.0: " + ("sprouting repaired" if repaired else "minimize()")
        told = self._counted(
            lambda searches: rivals.run_pyhms(searches, self.seed, repaired=repaired), runs, budget, note
        )
        return told._replace(seconds=told.seconds + told.own)

    def _counted(self, search: Callable[[list[rivals.SteamRun]], float], runs: int, budget: int, note: str) -> Outcome:
        for size in (1, WIDE):  # compiles
            self.costs(np.full((size, self.objective.dimension), 0.5))
        searches = [rivals.new_run(self.costs, self.objective.dimension, budget, k) for k in range(runs)]
        began = time.process_time()
        own = search(searches)
        seconds = time.process_time() - began
        finer = self.finer(np.stack([s.best_z for s in searches]))
        return Outcome(
            np.array([s.best for s in searches]), finer, np.array([s.evaluations for s in searches]), seconds, own, note
        )


Task = dict[str, Callable[[], Outcome]]


def from_anywhere(bench: Bench, runs: int, budget: int) -> Task:
    """Methods and references from the whole box, by name, cheapest first."""
    own: Task = {n: (lambda n=n: bench.ours(n, bench.objective, min(runs, FEW.get(n, runs)), budget)) for n in OURS}
    others: Task = {
        n: (lambda n=n, r=r: bench.reference(r, runs, budget, together=n in rivals.ONE_BY_ONE))
        for n, r in rivals.BOX.items()
    }
    hms: Task = {n: (lambda r=r: bench.pyhms(r, min(runs, rivals.PYHMS_RUNS), budget)) for n, r in rivals.PYHMS.items()}
    slow = OURS[OURS.index("least_squares") :]
    return {n: call for n, call in own.items() if n not in slow} | others | {n: own[n] for n in slow} | hms


def from_static(bench: Bench, runs: int, budget: int) -> Task:
    """The same from the static solution, which is found when it is first needed."""

    def ours(name: str) -> Outcome:
        started = dataclasses.replace(bench.objective, start=bench.static[None])
        return bench.ours(name, started, 1 if name in DRAWLESS else runs, budget)

    own: Task = {n: (lambda n=n: ours(n)) for n in OURS_LOCAL}
    return own | {
        f"pycma-{s:g}": (lambda s=s: bench.reference(rivals.pycma_from(bench.static, s), runs, budget)) for s in STEPS
    }


TASKS = {"box": (from_anywhere, PAIRS), "static": (from_static, PAIRS_LOCAL)}


# -- files and tables -------------------------------------------------------------------------------


def measure(options: argparse.Namespace) -> None:
    """Run what is missing in the folder."""
    bench = Bench(options.record_seed, options.seed)
    options.out.mkdir(parents=True, exist_ok=True)
    _save(_file(options, "facts", "record"), truth=bench.truth)
    for task in options.tasks:
        if task == "static":
            _save(_file(options, "facts", "static"), cost=bench.costs(bench.static[None])[0])
        for name, call in TASKS[task][0](bench, options.runs, options.budget).items():
            file = _file(options, task, name)
            if file.exists() or (options.only and name not in options.only):
                continue
            began = time.perf_counter()
            try:
                outcome = call()
            except (Missing, importlib.metadata.PackageNotFoundError) as error:
                print(f"SKIPPED {task} {name}: {error}", flush=True)
                continue
            _save(file, **outcome._asdict())
            middle = np.median(outcome.costs) / FLOOR
            print(
                f"{task} {name}: median {middle:.3g}, {outcome.seconds:.0f} CPU s, {time.perf_counter() - began:.0f} s",
                flush=True,
            )


def _file(options: argparse.Namespace, task: str, name: str) -> Path:
    return (
        options.out
        / f"{task}-{name}-record{options.record_seed}-seed{options.seed}-budget{options.budget}-runs{options.runs}.npz"
    )


def _save(file: Path, **arrays: Any) -> None:
    """Whole or not at all."""
    part = file.with_suffix(".part.npz")
    np.savez(part, **arrays)
    os.replace(part, file)


def stored(options: argparse.Namespace, task: str) -> dict[str, Outcome]:
    """What the folder holds of a task, in the order of measurement."""
    bench: Any = None  # the names need no record
    found = {}
    for name in TASKS[task][0](bench, options.runs, options.budget):
        file = _file(options, task, name)
        if file.exists():
            with np.load(file) as kept:
                found[name] = Outcome(*(kept[f] if kept[f].ndim else kept[f].item() for f in Outcome._fields))
    return found


def show(options: argparse.Namespace) -> None:
    """Print the tables."""
    print(
        f"record: noise seed {options.record_seed} (WORKLOADS has {WORKLOAD_SEED}); runs: seed {options.seed}, budget "
        f"{options.budget}"
    )
    for fact, sentence in (("record", "cost of the truth"), ("static", "static solution")):
        file = _file(options, "facts", fact)
        if file.exists():
            with np.load(file) as kept:
                print(f"{sentence}: {float(next(iter(kept.values()))) / FLOOR:.4f} of the noise floor {FLOOR:g} bar^2")
    for task in options.tasks:
        found = stored(options, task)
        if found:
            print(
                f"\n{task}: final cost over the floor; `finer`: median of the same answers with {FINER} steps a sample"
            )
            _print_costs(found)
            _print_pairs(found, TASKS[task][1])
        missing = [n for n in TASKS[task][0](None, 1, 1) if n not in found]  # pyrefly: ignore[bad-argument-type]
        if missing:
            print(f"not measured: {', '.join(missing)}")


def _print_costs(found: dict[str, Outcome]) -> None:
    print(
        f"{'':24}{'runs':>5}{'evals':>8}"
        + "".join(f"{h:>9}" for h in ("min", "max", "median", "mean", "std", "finer")),
        end="",
    )
    print(f"{'CPU s':>8}{'own':>8}  note")
    for name, o in sorted(found.items(), key=lambda item: float(np.median(item[1].costs))):
        ratio, n = o.costs / FLOOR, len(o.costs)
        spread = float(np.std(ratio, ddof=1)) if n > 1 else np.nan
        figures = (ratio.min(), ratio.max(), np.median(ratio), ratio.mean(), spread, np.median(o.finer) / FLOOR)
        cells = "".join(f"{v:9.3g}" if v >= 10 or v != v else f"{v:9.3f}" for v in figures)
        print(f"{name:24}{n:5d}{np.median(o.evaluations):8.0f}{cells}{o.seconds:8.1f}{o.own:8.1f}  {o.note}")


def _print_pairs(found: dict[str, Outcome], pairs: dict[str, tuple[str, ...]]) -> None:
    """Medians of ours over the reference's, and the Mann-Whitney test that neither is lower."""
    print(f"{'ours / reference':46}{'of medians':>11}{'p':>9}")
    for name, references in pairs.items():
        for other in references:
            if name in found and other in found:
                a, b = found[name].costs, found[other].costs
                p = mannwhitneyu(a, b).pvalue
                print(f"{name + ' / ' + other:46}{np.median(a) / np.median(b):11.3g}{p:9.2g}")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.steam.portfolio", description=str(__doc__).split("\n\n")[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--record-seed", type=int, default=RECORD_SEED, help=f"of the noise (default {RECORD_SEED})")
    parser.add_argument("--seed", type=int, default=RUN_SEED, help=f"of the runs (default {RUN_SEED})")
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--budget", type=int, default=BUDGET)
    parser.add_argument("--tasks", nargs="+", choices=tuple(TASKS), default=list(TASKS))
    parser.add_argument("--only", nargs="+", help="names of methods")
    parser.add_argument("--table", action="store_true", help="print what is there and measure nothing")
    options = parser.parse_args()
    if not options.table:
        measure(options)
    show(options)


if __name__ == "__main__":
    main()
