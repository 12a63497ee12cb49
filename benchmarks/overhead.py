"""`python -m benchmarks.overhead`: processor time that an optimizer itself spends on one evaluation, beside other
packages'.

Rosenbrock's function in 10-D, 100 runs side by side, as many candidates a generation as the reference has. Ours is the
whole search between its first and last report of progress, the cost with it (some 10 ns); from a reference's the time
spent in the cost is taken off. Below it one generation of CMA-ES in 310-D.
"""

import os
import time
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize import minimise
from plantfit.optimize.contract import Facts, Objective
from plantfit.optimize.loop.progress import Progress
from plantfit.optimize.registry import REGISTRY, make

import jax.numpy as jnp
from jax import Array

DIMENSION, RUNS, BUDGET = 10, 100, 2000
LARGE, LARGE_RUNS, GENERATIONS = 310, (2, 10), 200
WIDTH = 4.0  # of the box [-2, 2]
ASKED, ASKED_MS = 20, 3.0  # times less than a reference; ms a generation in 310-D
REPEATS = 3

Minimise = Callable[["Counted", int, int], None]  # (cost, population, seed)


def rosenbrock(z: Array) -> Array:
    """Costs (n,) of cube points (n, d)."""
    x = WIDTH * (z - 0.5)
    return jnp.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)


class Spent(Exception):
    """The budget is spent; ends a reference from inside."""


class Counted:
    """The same cost for numpy; `outside` is the processor time that it took itself."""

    def __init__(self, dimension: int, budget: int):
        self.dimension, self.budget, self.evaluations, self.outside = dimension, budget, 0, 0.0

    def costs(self, z: Any) -> np.ndarray:
        began = time.process_time()
        if self.evaluations >= self.budget:
            raise Spent
        x = WIDTH * (np.asarray(z, dtype=float) - 0.5)
        f = np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)
        self.evaluations += len(x)
        self.outside += time.process_time() - began
        return f

    def __call__(self, z: Any) -> float:
        return float(self.costs(np.asarray(z)[None])[0])


# -- ours -------------------------------------------------------------------------------------------


def ours(name: str, dimension: int, runs: int, budget: int, settings: Mapping[str, Any] | None = None) -> float:
    """Processor seconds for one evaluation, the median of REPEATS searches."""
    lower, upper = np.full(dimension, -WIDTH / 2), np.full(dimension, WIDTH / 2)
    objective = Objective(dimension, rosenbrock, lower=lower, upper=upper)
    found = []
    for repeat in range(REPEATS):
        marks: list[tuple[float, float]] = []

        def mark(progress: Progress, marks: list[tuple[float, float]] = marks) -> None:
            marks.append((time.process_time(), progress.evaluations))

        minimise(objective, name, runs=runs, budget=budget, seed=repeat, settings=settings, progress=mark)
        (began, first), (ended, last) = marks[0], marks[-1]
        found.append((ended - began) / (last - first))
    return float(np.median(found))


def rows(name: str, dimension: int, budget: int) -> int:
    """Candidates of one generation."""
    return make(name).rows(Facts(dimension, budget, np.zeros(dimension), np.ones(dimension)))  # pyrefly: ignore[missing-attribute]


# -- references -------------------------------------------------------------------------------------


def reference(start: Minimise, population: int, dimension: int, runs: int, budget: int) -> float:
    """Processor seconds for one evaluation without the cost, the median of `runs` searches after a short one that
    imports."""
    found = []
    for seed, allowed in enumerate([3 * population, *[budget] * runs]):
        cost = Counted(dimension, allowed)
        began = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                start(cost, population, seed)
        except (Spent, RuntimeError):  # minionpy turns an exception of the cost into a RuntimeError
            if cost.evaluations < allowed:
                raise
        found.append((time.process_time() - began - cost.outside) / cost.evaluations)
    return float(np.median(found[1:]))


def pycma(cost: Counted, population: int, seed: int, *, diagonal: bool = False, decoding: bool = False) -> None:
    import cma

    options = {
        "bounds": [0, 1],
        "popsize": population,
        "CMA_diagonal": diagonal,
        "CMA_diagonal_decoding": decoding,
        "seed": seed + 1,
    }
    options |= {"verbose": -9, "verb_log": 0, "signals_filename": ""}
    es = cma.CMAEvolutionStrategy(np.random.default_rng(seed).random(cost.dimension), 0.3, options)
    while not es.stop():
        x = es.ask()
        es.tell(x, cost.costs(np.array(x)).tolist())


def pymoo(cost: Counted, population: int, seed: int, *, name: str) -> None:
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.algorithms.soo.nonconvex.pso import PSO
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize
    from pymoo.termination import get_termination

    class Boxed(Problem):
        def _evaluate(self, x, out, *args, **kwargs):
            out["F"] = cost.costs(x)[:, None]

    kinds: dict[str, Any] = {"PSO": partial(PSO, adaptive=False, pertube_best=False), "GA": GA, "DE": DE}
    box = Boxed(n_var=cost.dimension, n_obj=1, xl=0.0, xu=1.0)
    minimize(box, kinds[name](pop_size=population), get_termination("n_eval", 10**9), seed=seed, verbose=False)


def mealpy(cost: Counted, population: int, seed: int, *, name: str) -> None:
    from mealpy import SHADE, SSO, FloatVar

    kinds: dict[str, Any] = {"SSO": SSO.OriginalSSO, "SHADE": SHADE.OriginalSHADE, "L-SHADE": SHADE.L_SHADE}
    box: Any = {"lb": [0.0] * cost.dimension, "ub": [1.0] * cost.dimension}
    task = {"obj_func": cost, "bounds": FloatVar(**box), "minmax": "min", "log_to": None}
    kinds[name](epoch=cost.budget // population + 1, pop_size=population).solve(task, seed=seed)


def minionpy(cost: Counted, population: int, seed: int, *, name: str) -> None:
    import minionpy as package

    options = {"population_size": population, "x_tol": 0.0}
    box = [(0.0, 1.0)] * cost.dimension
    getattr(package, name)(
        lambda x: cost.costs(x).tolist(), box, maxevals=cost.budget, seed=seed, options=options
    ).optimize()


REFERENCES: dict[str, Minimise] = {
    "pycma": pycma,
    "pycma, diagonal": partial(pycma, diagonal=True),
    "pymoo PSO": partial(pymoo, name="PSO"),
    "pymoo GA": partial(pymoo, name="GA"),
    "pymoo DE": partial(pymoo, name="DE"),
    "pycma, dd": partial(pycma, decoding=True),
    "mealpy SSO": partial(mealpy, name="SSO"),
    "mealpy SHADE": partial(mealpy, name="SHADE"),
    "mealpy L-SHADE": partial(mealpy, name="L-SHADE"),
    "minionpy L-SHADE": partial(minionpy, name="LSHADE"),
    "minionpy jSO": partial(minionpy, name="jSO"),
}
BESIDE = {
    "cmaes": "pycma",
    "dd_cmaes": "pycma, dd",
    "sep_cmaes": "pycma, diagonal",
    "pso": "pymoo PSO",
    "cga": "pymoo GA",
    "elite_ga": "pymoo GA",
    "sea": "pymoo GA",
    "binary_ga": "pymoo GA",
    "de": "pymoo DE",
    "shade": "mealpy SHADE",
    "lshade": "mealpy L-SHADE",
    "jso": "mealpy L-SHADE",
    "dish": "mealpy L-SHADE",
    "salp_swarm": "mealpy SSO",
}
# these do less
SIMPLER = {"dd_cmaes": "pycma", "shade": "pymoo DE", "lshade": "pymoo DE", "jso": "pymoo DE", "dish": "pymoo DE"}
COMPILED = {"lshade": "minionpy L-SHADE", "jso": "minionpy jSO"}  # C++ that calls back
LARGE_BESIDE = {"cmaes": "pycma", "sep_cmaes": "pycma, diagonal", "dd_cmaes": "pycma"}


class Line(NamedTuple):
    """Processor seconds for one evaluation."""

    method: str
    population: int
    own: float
    reference: str
    theirs: float

    @property
    def ratio(self) -> float:
        return self.theirs / self.own


def small(runs: int) -> list[Line]:
    """10-D; every method whose generations are compiled, `runs` searches of each reference."""
    lines = []
    names = [n for n, entry in REGISTRY.items() if hasattr(entry.kind, "rows")]
    for name in names:
        population, own = rows(name, DIMENSION, BUDGET), ours(name, DIMENSION, RUNS, BUDGET)
        others = [known[name] for known in (BESIDE, SIMPLER, COMPILED) if name in known]
        for other in others or [""]:
            theirs = reference(REFERENCES[other], population, DIMENSION, runs, BUDGET) if other else np.nan
            lines.append(Line(name, population, own, other, theirs))
            _print(lines[-1])
    return lines


def large(generations: int) -> list[Line]:
    """310-D, with few and with many runs side by side: their matrices fit into the caches, or do not."""
    lines = []
    for name, other in LARGE_BESIDE.items():
        population = rows(name, LARGE, generations)
        budget = generations * population
        theirs = reference(REFERENCES[other], population, LARGE, 1, budget)
        for runs in LARGE_RUNS:
            line = Line(f"{name}, {runs} runs", population, ours(name, LARGE, runs, budget), other, theirs)
            own, beside = (1e3 * population * seconds for seconds in (line.own, theirs))
            print(
                f"{line.method:18}{population:6}{own:10.2f} ms   {other:20}{beside:9.2f} ms{line.ratio:10.1f}",
                flush=True,
            )
            lines.append(line)
    return lines


def _print(line: Line) -> None:
    theirs = f"{1e6 * line.theirs:9.1f} us{line.ratio:10.1f}" if line.reference else ""
    print(f"{line.method:18}{line.population:6}{1e6 * line.own:10.2f} us   {line.reference:20}{theirs}", flush=True)


def run(quick: bool) -> dict[str, float]:
    """Print the tables and return the ratios."""
    head = f"{'':18}{'rows':>6}{'own':>13}   {'reference':20}{'own':>12}{'ratio':>10}"
    print(
        f"own processor time of one evaluation, {DIMENSION}-D, "
        f"{RUNS} runs side by side, {BUDGET} evaluations each\n{head}"
    )
    lines = small(1 if quick else 5)
    print(f"own processor time of one generation, {LARGE}-D\n{head}")
    wide = large(GENERATIONS // (4 if quick else 1))
    short = [x.method for x in lines if x.reference and x.reference == BESIDE.get(x.method) and x.ratio < ASKED]
    slow = [x.method for x in wide if 1e3 * x.own * x.population >= ASKED_MS]
    print(f"less than {ASKED} times below the reference: {', '.join(short) or 'none'}")
    print(f"{ASKED_MS:g} ms or more: {', '.join(slow) or 'none'}")
    figures = {f"overhead_{x.method}_over_{x.reference}": x.ratio for x in lines if x.reference}
    figures |= {f"overhead_310d_{x.method}_ms": 1e3 * x.own * x.population for x in wide}
    return {name.replace(",", "").replace(" ", "_"): value for name, value in figures.items()}


if __name__ == "__main__":
    run(os.environ.get("QUICK", "") not in ("", "0"))
