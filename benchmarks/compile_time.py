"""`python -m benchmarks.compile_time`: programs around native loops and generations of searches, compiled as
`runtime.jit` does ("quick"), as XLA does by itself in one part ("plain") and in its 32 parts ("parts").

Compiled anew in turns, with XLA's cache off, and called in turns: a motor under a held voltage (1500 samples), the
steam chamber (ten openings of 2440 samples, 310 parameters), and methods in ten dimensions. Seconds and milliseconds
are of the process, so that other work counts little; the ratios are those of medians.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import numpy as np

from benchmarks import data, motor
from benchmarks.steam.ours import problem as steam_problem
from plantfit.optimize.contract import Facts, Population
from plantfit.optimize.registry import make
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.runtime import compiler_options

import jax
import jax.numpy as jnp

TURNS, CALLS = 3, 30
CANDIDATES = 20
OPTIONS: dict[str, dict[str, Any]] = {
    "quick": compiler_options(),
    "plain": {},
    "parts": {"xla_cpu_parallel_codegen_split_count": 32},
}
SEARCHES, DIMENSION = ("pso", "cga", "cmaes", "shade", "jso"), 10


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: quick over plain to compile and to call, and plain over parts to compile
    (`whole`)."""
    jax.config.update("jax_enable_compilation_cache", False)
    figures: dict[str, float] = {}
    print(f"{'':38}{'compile, s':^43}{'call, ms':^35}")
    kinds = "".join(f"{kind:>9}" for kind in OPTIONS)
    print(f"{'program':38}{kinds}{'q/pl':>8}{'pl/pa':>8}{kinds}{'q/pl':>8}")
    for name, function, args in (*_programs(), *_generations()):
        made: dict[str, list[float]] = {kind: [] for kind in OPTIONS}
        called: dict[str, list[float]] = {kind: [] for kind in OPTIONS}
        ready: dict[str, Callable] = {}
        for _ in range(1 if quick else TURNS):
            for kind, chosen in OPTIONS.items():
                # one that was compiled is not again
                lowered = jax.jit(lambda *given, function=function: function(*given)).lower(*args)
                began = time.process_time()
                ready[kind] = lowered.compile(chosen)
                made[kind].append(time.process_time() - began)
        for _ in range(CALLS):
            for kind, program in ready.items():
                began = time.process_time()
                jax.block_until_ready(program(*args))
                called[kind].append(1e3 * (time.process_time() - began))
        compiled, calls = ({kind: float(np.median(found[kind])) for kind in OPTIONS} for found in (made, called))
        ratios = {
            "compile": compiled["quick"] / compiled["plain"],
            "whole": compiled["plain"] / compiled["parts"],
            "call": calls["quick"] / calls["plain"],
        }
        row = "".join(f"{seconds:9.2f}" for seconds in compiled.values())
        row += f"{ratios['compile']:8.2f}{ratios['whole']:8.2f}"
        row += "".join(f"{milliseconds:9.3f}" for milliseconds in calls.values())
        print(f"{name:38}{row}{ratios['call']:8.2f}", flush=True)
        brief = name.replace(",", "").replace(":", "").replace(" ", "_")
        figures |= {f"{what}_{brief}": ratio for what, ratio in ratios.items()}
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
