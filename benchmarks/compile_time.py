"""`python -m benchmarks.compile_time`: programs around native loops, compiled by XLA without its fusion emitters and
with them; and generations of searches, compiled as `make test` does (QUICK_XLA of the Makefile) and as users' are.

Compiled anew in turns, with XLA's cache off, and called in turns: a motor under a held voltage (1500 samples) and the
steam chamber (ten openings of 2440 samples, 310 parameters). The ratios are those of medians.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import numpy as np

import plantfit.runtime  # noqa: F401  (one XLA thread before jax starts)
from benchmarks import data, motor
from benchmarks.steam.ours import problem as steam_problem
from plantfit.native.kept_programs import NO_FUSION_EMITTERS
from plantfit.optimize.contract import Facts, Population
from plantfit.optimize.registry import make
from plantfit.problem.accuracy.steps import choose_substeps

import jax
import jax.numpy as jnp

TURNS, CALLS = 3, 30
CANDIDATES = 20
OPTIONS: dict[str, dict[str, Any]] = {"without": NO_FUSION_EMITTERS, "with": {}}
QUICK: dict[str, dict[str, Any]] = {
    "quick": {**NO_FUSION_EMITTERS, "xla_backend_optimization_level": 1},
    "as users'": {},
}
SEARCHES, DIMENSION = ("pso", "cga", "cmaes", "shade", "jso"), 10


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: times without the emitters over times with them."""
    jax.config.update("jax_enable_compilation_cache", False)
    return {**_compared(OPTIONS, _programs(), quick), **_compared(QUICK, _generations(), quick)}


def _compared(
    options: dict[str, dict[str, Any]], programs: Iterator[tuple[str, Callable, tuple[Any, ...]]], quick: bool
) -> dict[str, float]:
    figures: dict[str, float] = {}
    first, second = options
    print(f"{'':38}{'compile, s':^29}{'call, ms':^29}")
    print(f"{'program':38}" + 2 * f"{first:>10}{second:>11}{'ratio':>8}")
    for name, function, args in programs:
        made: dict[str, list[float]] = {kind: [] for kind in options}
        called: dict[str, list[float]] = {kind: [] for kind in options}
        ready: dict[str, Callable] = {}
        for _ in range(1 if quick else TURNS):
            for kind, chosen in options.items():
                # one that was compiled is not again
                lowered = jax.jit(lambda *given, function=function: function(*given)).lower(*args)
                began = time.perf_counter()
                ready[kind] = lowered.compile(chosen)
                made[kind].append(time.perf_counter() - began)
        for _ in range(CALLS):
            for kind, program in ready.items():
                began = time.perf_counter()
                jax.block_until_ready(program(*args))
                called[kind].append(1e3 * (time.perf_counter() - began))
        (a, b), (c, d) = ([float(np.median(found[kind])) for kind in options] for found in (made, called))
        print(f"{name:38}{a:10.2f}{b:11.2f}{a / b:8.2f}{c:10.3f}{d:11.3f}{c / d:8.2f}", flush=True)
        plain = name.replace(",", "").replace(":", "").replace(" ", "_")
        word = first.replace("without", "without_emitters")
        figures |= {f"compile_{word}_{plain}": a / b, f"call_{word}_{plain}": c / d}
    return figures


def _generations() -> Iterator[tuple[str, Callable, tuple[Any, ...]]]:
    """By method one generation of it, and its key and state."""
    for name in SEARCHES:
        method = cast(Population, make(name))

        def generation(key: Any, state: Any, method: Population = method) -> Any:
            x, asked = method.ask(key, state)
            return method.tell(asked, x, jnp.sum((x - 0.3) ** 2, axis=1))

        key = jax.random.key(1)
        yield f"{name}: a generation", generation, (key, method.init(key, Facts(DIMENSION, 10_000)))


def _programs() -> Iterator[tuple[str, Callable, tuple[Any, ...]]]:
    """By plant and name functions, and what they are called with."""
    for plant, problem in (
        ("motor", choose_substeps(motor._problem(data.motor()))),
        ("steam", steam_problem(data.steam())),
    ):
        batch = np.random.default_rng(5).uniform(size=(CANDIDATES, problem.space.dimension))
        kept = {n: k.__wrapped__ for n, k in problem.compiled.items() if hasattr(k, "__wrapped__")}
        yield f"{plant}: costs, 1", kept["costs"], (batch[:1], problem.arguments)
        for name in ("costs", "values_and_gradients"):
            yield f"{plant}: {name}, {CANDIDATES}", kept[name], (batch, problem.arguments)
        for name in ("residuals", "residuals_and_jacobian", "blocks"):
            yield f"{plant}: {name}", kept[name], (batch[0], problem.arguments)


if __name__ == "__main__":
    run(False)
