"""plantfit's methods on BBOB: the instances of a function side by side, costs computed outside jax.

This is a driver of its own, because the loops of plantfit.optimize want a cost that jax can trace. It keeps their
contract: generation g of a run asks with fold_in(run key, g), a generation that does not fit into the budget is not
started, and rows that a method does not declare live are neither evaluated nor counted. A run that ends by its own rule
begins anew with the budget that is left, as restarts of the reference do; methods with a schedule end.
"""

import functools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.bbob.references import jso_population
from benchmarks.bbob.suite import LOWER, UPPER, Done, Run, seed_of
from plantfit.errors import Status
from plantfit.optimize.contract import Facts, Objective
from plantfit.optimize.loop.counter import BudgetSpent, Counter
from plantfit.optimize.registry import REGISTRY, make

import jax
import jax.numpy as jnp
from jax import Array, lax


class Ours(NamedTuple):
    """A registered method with settings, which may depend on the dimension, and the references it is held to."""

    method: str
    settings: dict[str, Any] | Callable[[int], dict[str, Any]]
    references: tuple[str, ...]

    def made(self, dimension: int) -> Any:
        return make(self.method, **(self.settings(dimension) if callable(self.settings) else self.settings))


REFERENCES_OF: dict[str, tuple[str, ...]] = {
    "auto": ("pycma-bipop",),
    "lbfgsb": ("scipy-lbfgsb",),
    "cmaes": ("pycma",),
    "sep_cmaes": ("pycma-sep",),
    "dd_cmaes": ("pycma",),
    "ipop_cmaes": ("pycma-ipop",),
    "bipop_cmaes": ("pycma-bipop",),
    "pso": ("pymoo-pso", "minion-pso"),
    "cga": ("pymoo-ga",),
    "sea": ("pymoo-ga",),
    "elite_ga": ("pymoo-ga",),
    "binary_ga": ("pymoo-binary-ga",),
    "salp_swarm": ("mealpy-sso",),
    "de": ("pymoo-de", "pymoo-de-published"),
    "shade": ("minion-shade",),
    "lshade": ("minion-lshade-few", "minion-lshade"),
    "jso": ("minion-jso-few", "minion-jso"),
    "dish": ("dish-python", "dish-python-repaired"),
    "hms": ("pyhms", "pyhms-repaired"),
    "nelder_mead": ("scipy-nelder-mead",),
}
"""A method that is not here (a family without a rival) is held to random search."""

VARIANTS = {
    "pso-ring": Ours("pso", {"topology": "ring"}, ("pymoo-pso",)),
    "cga-sbx": Ours("cga", {"crossover": "sbx"}, ("pymoo-ga",)),
    "binary_ga-plain": Ours("binary_ga", {"coding": "plain"}, ("pymoo-binary-ga",)),
    "salp_swarm-paper": Ours("salp_swarm", {"variant": "paper"}, ("mealpy-sso",)),
    "salp_swarm-shift_invariant": Ours("salp_swarm", {"variant": "shift_invariant"}, ("mealpy-sso",)),
    "de-best": Ours("de", {"strategy": "best/1"}, ("scipy-de",)),
    "lshade-paper-n": Ours("lshade", lambda d: {"population": 18 * d}, ("minion-lshade",)),
    "jso-paper-n": Ours("jso", lambda d: {"population": jso_population(d)}, ("minion-jso",)),
    "lshade-nearest": Ours("lshade", {"rounding": "nearest"}, ("minion-lshade-few",)),
    "jso-nearest": Ours("jso", {"rounding": "nearest"}, ("minion-jso-few",)),
    "lshade-paper-n-nearest": Ours(
        "lshade", lambda d: {"population": 18 * d, "rounding": "nearest"}, ("minion-lshade",)
    ),
    "jso-paper-n-nearest": Ours(
        "jso", lambda d: {"population": jso_population(d), "rounding": "nearest"}, ("minion-jso",)
    ),
    "cmaes-penalty": Ours("cmaes", {"bounds": "penalty"}, ("pycma",)),
    "cmaes-mirror": Ours("cmaes", {"bounds": "mirror"}, ("pycma",)),
}


def portfolio() -> dict[str, Ours]:
    """Every registered method by its name with its defaults, then the variants."""
    return {name: Ours(name, {}, REFERENCES_OF.get(name, ("numpy-random",))) for name in REGISTRY} | VARIANTS


def unfit(ours: Ours) -> str | None:
    """Why a method cannot run on BBOB, None when it can."""
    if REGISTRY[ours.method].kind.needs.residuals:
        return "needs residuals, and a BBOB function has none"
    return None


def run_ours(ours: Ours, runs: list[Run], seed: int) -> float:
    """All runs of a method; processor seconds without compilation."""
    method = ours.made(runs[0].dimension)
    if hasattr(method, "choose"):
        method, _ = method.choose(_objective(runs[0], gradient=False), runs[0].budget)
    seeds = [seed_of(seed, r.problem.function, r.dimension, r.problem.instance) for r in runs]
    if hasattr(method, "run"):
        began = time.process_time()
        for run, one in zip(runs, seeds, strict=True):
            _run_host(method, run, jax.random.key(one))
        return time.process_time() - began
    return _run_population(method, runs, seeds)


class Compiled(NamedTuple):
    """`first` (keys) and `next` (keys, g, anew, state, x, f, reborn) return (x, state, live); `next` adds who has
    ended."""

    first: Callable
    next: Callable


@functools.lru_cache(maxsize=8)
def _compiled(method: Any, dimension: int, budget: int) -> Compiled:
    facts = _facts(dimension, budget)
    period = method.refresh_period(facts) if hasattr(method, "refresh") else None
    rows = method.rows(facts)

    def ask(keys: Array, g: Array, state: Any) -> tuple[Array, Any, Array]:
        if period is not None:
            state = lax.cond(g % period == 0, jax.vmap(method.refresh), lambda s: s, state)
        x, state = jax.vmap(lambda key, s: method.ask(jax.random.fold_in(key, g), s))(keys, state)
        live = jnp.clip(jax.vmap(method.live)(state), 1, rows) if hasattr(method, "live") else jnp.full(len(keys), rows)
        return x, state, live

    def born(keys: Array, times: Array) -> Any:
        # beyond the numbers of generations
        state = jax.vmap(lambda key, n: method.init(jax.random.fold_in(key, 2**31 + n), facts))(
            keys, times.astype(jnp.uint32)
        )
        return jax.tree.map(lambda a: lax.convert_element_type(a, a.dtype), state)

    def first(keys: Array) -> tuple[Array, Any, Array]:
        return ask(keys, jnp.zeros((), int), born(keys, jnp.zeros(len(keys), int)))

    def step(keys: Array, g: Array, times: Array, state: Any, x: Array, f: Array):
        state, info = jax.vmap(method.tell)(state, x, f)
        no = jnp.zeros(len(keys), bool)
        ended = info.get("stop", no) | info.get("stagnated", no)
        if not method.needs.schedule_bound:
            times = times + ended

            def anew(old: Any) -> Any:
                fresh = born(keys, times)
                return jax.tree.map(lambda a, b: jnp.where(ended.reshape(-1, *[1] * (a.ndim - 1)), a, b), fresh, old)

            state = lax.cond(jnp.any(ended), anew, lambda old: old, state)
        return *ask(keys, g, state), ended, times

    return Compiled(jax.jit(first), jax.jit(step))


def _facts(dimension: int, budget: int) -> Facts:
    return Facts(dimension, budget, np.full(dimension, LOWER), np.full(dimension, UPPER))


def _run_population(method: Any, runs: list[Run], seeds: list[int]) -> float:
    dimension, budget = runs[0].dimension, runs[0].budget
    compiled = _compiled(method, dimension, budget)
    keys = jnp.stack([jax.random.key(s) for s in seeds])
    times = jnp.zeros(len(runs), int)
    x, state, live = compiled.first(keys)
    jax.block_until_ready(compiled.next(keys, 1, times, state, x, np.full(x.shape[:2], np.inf)))
    began = time.process_time()
    going = np.ones(len(runs), dtype=bool)
    for g in range(1, budget + 1):
        points, rows = np.asarray(x), np.asarray(live)
        f = np.full(points.shape[:2], np.inf)
        for k, run in enumerate(runs):
            going[k] &= not run.done and rows[k] <= run.remaining
            if going[k]:
                f[k, : rows[k]] = run.costs(LOWER + (UPPER - LOWER) * points[k, : rows[k]])
        if not going.any():
            break
        x, state, live, ended, times = compiled.next(keys, g, times, state, x, f)
        if method.needs.schedule_bound:
            going &= ~np.asarray(ended)
    return time.process_time() - began


class NumpyCounter(Counter):
    """A Counter whose costs come from a run, without filling chunks up to compiled shapes."""

    def __init__(self, run: Run, *, gradient: bool):
        super().__init__(_objective(run, gradient=gradient), run.remaining)
        self._run = run

    def _chunk(self, x: np.ndarray, size: int) -> np.ndarray:
        return self._run.costs(LOWER + (UPPER - LOWER) * x)


def _objective(run: Run, *, gradient: bool) -> Objective:
    """A cost that jax does not see; if asked for with a gradient by forward differences, which costs d + 1
    evaluations."""

    def hidden(x: Array) -> Array:
        raise TypeError("A BBOB function cannot be traced; it is evaluated through NumpyCounter.")

    def value_and_gradient(z: np.ndarray) -> tuple[float, np.ndarray]:
        step = np.where(z < 0.5, 1e-8, -1e-8)  # inwards
        f = run.costs(LOWER + (UPPER - LOWER) * np.vstack([z, z + np.diag(step)]))
        return float(f[0]), (f[1:] - f[0]) / step

    d = run.dimension
    return Objective(
        d,
        hidden,
        value_and_gradient if gradient else None,
        gradient_charge=d + 1.0,
        lower=np.full(d, LOWER),
        upper=np.full(d, UPPER),
    )


def _run_host(method: Any, run: Run, key: Array) -> None:
    for restart in range(10_000):
        before = run.evaluations
        counter = NumpyCounter(run, gradient=method.needs.gradient)
        try:
            status = method.run(jax.random.fold_in(key, restart), counter.objective, run.remaining, counter)
        except (BudgetSpent, Done):
            return
        if (
            run.done
            or run.evaluations == before
            or status in (Status.budget, Status.failed)
            or method.needs.schedule_bound
        ):
            return


def about(ours: Ours, dimension: int, budget: int) -> dict[str, Any]:
    """Package, version and settings as text for the results."""
    import plantfit

    return {"package": f"plantfit {plantfit.__version__}", "settings": repr(ours.made(dimension)), "budget": budget}
