"""Reference implementations, each as one start on a `Run`: `start(run, seed)` minimises until it stops by its own rule
or `run` raises Done; the driver begins anew with what is left of the budget.

Settings are those the package recommends, with its tolerances opened so far that the last target (1e-8) can be met, or,
where a package is there to check the same algorithm, ours (docs/bbob.md has the table).
"""

import importlib.metadata
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bbob.suite import LOWER, UPPER, Done, Run, seed_of

Start = Callable[[Run, int], None]
WIDTH = UPPER - LOWER


@dataclass(frozen=True)
class Reference:
    """How one start is made, the package behind it, and what a reader has to know of its settings."""

    start: Start
    package: str
    settings: str


def run_reference(reference: Reference, runs: list[Run], seed: int) -> float:
    """All runs, each restarted until it is done; processor seconds. Raises what the package raises."""
    began = time.process_time()
    for run in runs:
        _restarted(reference.start, run, seed_of(seed, run.problem.function, run.dimension, run.problem.instance))
    return time.process_time() - began


def _restarted(start: Start, run: Run, seed: int) -> None:
    for one in np.random.SeedSequence(seed).generate_state(10_000):
        before = run.evaluations
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                start(run, int(one >> 1))
        except Done:
            return
        except RuntimeError:
            if not run.done:  # minionpy turns an exception of the cost into a RuntimeError
                raise
        if run.done or run.evaluations == before:  # a start that fits no longer into the rest of the budget
            return


def version(package: str) -> str:
    """Name and version of an installed package. Raises PackageNotFoundError."""
    return f"{package} {importlib.metadata.version(package)}"


def numpy_random(run: Run, seed: int) -> None:
    rng = np.random.default_rng(seed)
    while True:
        run.costs(rng.uniform(LOWER, UPPER, (500, run.dimension)))


def scipy_nelder_mead(run: Run, seed: int) -> None:
    from scipy.optimize import minimize

    x0 = np.random.default_rng(seed).uniform(LOWER, UPPER, run.dimension)
    options = {"adaptive": True, "xatol": 1e-10, "fatol": 1e-12, "maxfev": 10**9, "maxiter": 10**9}
    minimize(run, x0, method="Nelder-Mead", bounds=[(LOWER, UPPER)] * run.dimension, options=options)


def scipy_lbfgsb(run: Run, seed: int) -> None:
    from scipy.optimize import minimize

    x0 = np.random.default_rng(seed).uniform(LOWER, UPPER, run.dimension)
    options = {"maxcor": 20, "maxls": 40, "ftol": 1e-15, "gtol": 1e-10, "maxfun": 10**9, "maxiter": 10**9}
    minimize(run, x0, method="L-BFGS-B", bounds=[(LOWER, UPPER)] * run.dimension, options=options)


def scipy_de(run: Run, seed: int) -> None:
    from scipy.optimize import differential_evolution

    bounds = [(LOWER, UPPER)] * run.dimension
    differential_evolution(run, bounds, tol=0.0, atol=0, maxiter=10**9, polish=False, rng=np.random.default_rng(seed))


CMA_QUIET = {"bounds": [LOWER, UPPER], "verbose": -9, "verb_log": 0, "signals_filename": ""}


def pycma(run: Run, seed: int, *, diagonal: bool = False) -> None:
    import cma

    x0 = np.random.default_rng(seed).uniform(LOWER, UPPER, run.dimension)
    es = cma.CMAEvolutionStrategy(x0, 0.3 * WIDTH, {**CMA_QUIET, "CMA_diagonal": diagonal, "seed": seed + 1})
    while not es.stop():
        x = es.ask()
        es.tell(x, run.costs(np.array(x)).tolist())


def pycma_restarts(run: Run, seed: int, *, bipop: bool) -> None:
    import cma

    rng = np.random.default_rng(seed)
    options = {**CMA_QUIET, "seed": seed + 1, "maxfevals": run.remaining}
    cma.fmin2(run, lambda: rng.uniform(LOWER, UPPER, run.dimension), 0.3 * WIDTH, options, restarts=9, bipop=bipop)


def _pymoo(run: Run, seed: int, algorithm: Any, variables: int, decode: Callable | None = None) -> None:
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize
    from pymoo.termination import get_termination

    class Boxed(Problem):
        def _evaluate(self, x, out, *args, **kwargs):
            out["F"] = run.costs(x if decode is None else decode(x))[:, None]

    if decode is None:
        problem = Boxed(n_var=variables, n_obj=1, xl=LOWER, xu=UPPER)
    else:
        problem = Boxed(n_var=variables, n_obj=1, xl=0, xu=1, vtype=bool)
    minimize(problem, algorithm, get_termination("n_eval", 10**9), seed=seed, verbose=False)


def swarm_size(dimension: int) -> int:
    """Particles of our swarm, so that the reference has as many."""
    return 40 if dimension >= 10 else 10 + math.floor(2 * math.sqrt(dimension))


def pymoo_pso(run: Run, seed: int) -> None:
    from pymoo.algorithms.soo.nonconvex.pso import PSO

    swarm = PSO(
        pop_size=swarm_size(run.dimension), adaptive=False, pertube_best=False, w=0.72984, c1=1.49618, c2=1.49618
    )
    _pymoo(run, seed, swarm, run.dimension)


def pymoo_ga(run: Run, seed: int) -> None:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM

    d = run.dimension
    _pymoo(
        run, seed, GA(pop_size=100, crossover=SBX(prob=0.9, eta=15), mutation=PM(prob=1.0, prob_var=1 / d, eta=20)), d
    )


BITS = 16


def gray_to_box(bits: np.ndarray) -> np.ndarray:
    """Points (n, d) of the box from Gray-coded bits (n, 16 d)."""
    plain = np.bitwise_xor.accumulate(np.asarray(bits, dtype=np.int64).reshape(len(bits), -1, BITS), axis=2)
    return LOWER + WIDTH * (plain @ 2 ** np.arange(BITS - 1, -1, -1)) / (2**BITS - 1)


def pymoo_binary_ga(run: Run, seed: int) -> None:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.operators.crossover.pntx import SinglePointCrossover
    from pymoo.operators.mutation.bitflip import BitflipMutation
    from pymoo.operators.sampling.rnd import BinaryRandomSampling

    n = run.dimension * BITS
    flip = BitflipMutation(prob=0.4, prob_var=1 / n)
    operators: Any = {"sampling": BinaryRandomSampling(), "crossover": SinglePointCrossover(prob=0.6), "mutation": flip}
    ga = GA(pop_size=50, **operators)
    _pymoo(run, seed, ga, n, gray_to_box)


def pymoo_de(run: Run, seed: int, *, mutated: float = 0.1) -> None:
    """`mutated` is the share of trials that pymoo's DE also sends through polynomial mutation; its own default."""
    from pymoo.algorithms.soo.nonconvex.de import DE

    d = run.dimension
    _pymoo(
        run, seed, DE(pop_size=min(max(5 * d, 20), 100), variant="DE/rand/1/bin", CR=0.9, F=0.5, prob_mut=mutated), d
    )


def minion(run: Run, seed: int, *, name: str, options: Callable[[int], dict[str, Any]]) -> None:
    import minionpy

    def costs(x: list[list[float]]) -> list[float]:
        return run.costs(x).tolist()

    bounds = [(LOWER, UPPER)] * run.dimension
    getattr(minionpy, name)(costs, bounds, maxevals=run.remaining, seed=seed, options=options(run.dimension)).optimize()


def few(paper: int, dimension: int) -> int:
    """Members that our L-SHADE and jSO begin with in place of the paper's, for 1000 d evaluations."""
    return min(paper, max(50, 10 * dimension))


def jso_population(dimension: int) -> int:
    """25 ln(d) sqrt(d), as our jSO rounds it."""
    return round(25 * math.log(dimension) * math.sqrt(dimension))


def lshade_options(dimension: int, *, fewer: bool = False) -> dict[str, Any]:
    """The paper's first population or ours; nothing ends a run before its budget."""
    return {"population_size": few(18 * dimension, dimension) if fewer else 18 * dimension, "x_tol": 0.0}


def jso_options(dimension: int, *, fewer: bool = False) -> dict[str, Any]:
    """The same for jSO."""
    n = jso_population(dimension)
    return {"population_size": few(n, dimension) if fewer else n, "x_tol": 0.0}


def fixed_population(dimension: int) -> dict[str, Any]:
    """Options that make SHADE of minionpy's L-SHADE: nothing shrinks, memory and archive as in Tanabe and Fukunaga
    2013."""
    return {
        "population_size": 100,
        "minimum_population_size": 100,
        "memory_size": 100,
        "archive_size_ratio": 1.0,
        "x_tol": 0.0,
    }


def dish_python(run: Run, seed: int, *, faults: bool) -> None:
    from benchmarks.bbob.dish_python_faults import dish_python

    dish_python(lambda z: run(LOWER + WIDTH * np.asarray(z)), run.dimension, run.remaining, seed, faults=faults)


def mealpy_sso(run: Run, seed: int) -> None:
    from mealpy import FloatVar
    from mealpy.swarm_based.SSO import OriginalSSO

    d, population = run.dimension, 50
    box: Any = {"lb": [LOWER] * d, "ub": [UPPER] * d}
    task = {"obj_func": run, "bounds": FloatVar(**box), "minmax": "min", "log_to": None}
    # the first population counts too
    OriginalSSO(epoch=max(1, run.remaining // population - 1), pop_size=population).solve(task, seed=seed)


REFERENCES: dict[str, Reference] = {
    "numpy-random": Reference(numpy_random, "numpy", "uniform points"),
    "minion-jso": Reference(
        partial(minion, name="jSO", options=jso_options), "minionpy", "N0 = 25 ln(d) sqrt(d), x_tol 0"
    ),
    "minion-jso-few": Reference(
        partial(minion, name="jSO", options=partial(jso_options, fewer=True)),
        "minionpy",
        "N0 at most max(50, 10 d), x_tol 0",
    ),
    "minion-lshade": Reference(
        partial(minion, name="LSHADE", options=lshade_options), "minionpy", "N0 = 18 d, x_tol 0"
    ),
    "minion-lshade-few": Reference(
        partial(minion, name="LSHADE", options=partial(lshade_options, fewer=True)),
        "minionpy",
        "N0 at most max(50, 10 d), x_tol 0",
    ),
    "minion-shade": Reference(
        partial(minion, name="LSHADE", options=fixed_population), "minionpy", "L-SHADE held at N = H = 100"
    ),
    "minion-pso": Reference(
        partial(minion, name="PSO", options=lambda d: {"x_tol": 0.0}), "minionpy", "defaults (N = 5 d), x_tol 0"
    ),
    "scipy-lbfgsb": Reference(scipy_lbfgsb, "scipy", "2-point differences counted, memory 20, restarted"),
    "scipy-nelder-mead": Reference(scipy_nelder_mead, "scipy", "adaptive, bounded, xatol 1e-10, restarted"),
    "dish-python": Reference(partial(dish_python, faults=True), "numpy", "as DISH_python publishes it, re-implemented"),
    "dish-python-repaired": Reference(partial(dish_python, faults=False), "numpy", "the same, faults repaired"),
    "pymoo-pso": Reference(pymoo_pso, "pymoo", "not adaptive, constriction coefficients, N = 40 (14 in 5-D)"),
    "pymoo-ga": Reference(pymoo_ga, "pymoo", "N = 100, SBX(0.9, 15), PM(1/d, 20)"),
    "pymoo-de": Reference(pymoo_de, "pymoo", "rand/1/bin, N = 5 d, F = 0.5, CR = 0.9, a tenth of the trials mutated"),
    "pymoo-de-published": Reference(
        partial(pymoo_de, mutated=0.0), "pymoo", "the same as published, without that mutation"
    ),
    "scipy-de": Reference(scipy_de, "scipy", "defaults (best/1/bin, N = 15 d), tol 0, no polish"),
    "mealpy-sso": Reference(mealpy_sso, "mealpy", "OriginalSSO, N = 50"),
    "pycma": Reference(pycma, "cma", "bounds, sigma0 = 0.3 ranges, uniform start, restarted"),
    "pycma-sep": Reference(partial(pycma, diagonal=True), "cma", "as pycma, CMA_diagonal"),
    "pycma-ipop": Reference(partial(pycma_restarts, bipop=False), "cma", "fmin2(restarts=9), otherwise as pycma"),
    "pycma-bipop": Reference(
        partial(pycma_restarts, bipop=True), "cma", "fmin2(restarts=9, bipop=True), otherwise as pycma"
    ),
    "pymoo-binary-ga": Reference(
        pymoo_binary_ga, "pymoo", "N = 50, 16 bits, Gray code, one-point 0.6, one flip in 0.4"
    ),
}
