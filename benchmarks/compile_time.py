"""`python -m benchmarks.compile_time`: programs around native loops, compiled by XLA without its fusion emitters and
with them.

Compiled anew in turns, with XLA's cache off, and called in turns: a motor under a held voltage (1500 samples) and the
steam chamber (ten openings of 2440 samples, 310 parameters). The ratios are those of medians.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401  (one XLA thread before jax starts)
from benchmarks import data, motor
from benchmarks.steam.ours import problem as steam_problem
from plantfit.native.kept_programs import NO_FUSION_EMITTERS
from plantfit.problem.accuracy.steps import choose_substeps

import jax

TURNS, CALLS = 3, 30
CANDIDATES = 20
OPTIONS: dict[str, dict[str, Any]] = {"without": NO_FUSION_EMITTERS, "with": {}}


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: times without the emitters over times with them."""
    jax.config.update("jax_enable_compilation_cache", False)
    figures: dict[str, float] = {}
    print(f"{'':38}{'compile, s':^27}{'call, ms':^27}")
    print(f"{'program':38}{'without':>10}{'with':>10}{'ratio':>7}{'without':>10}{'with':>10}{'ratio':>7}")
    for name, function, args in _programs():
        made: dict[str, list[float]] = {kind: [] for kind in OPTIONS}
        called: dict[str, list[float]] = {kind: [] for kind in OPTIONS}
        programs: dict[str, Callable] = {}
        for _ in range(1 if quick else TURNS):
            for kind, options in OPTIONS.items():
                # one that was compiled is not again
                lowered = jax.jit(lambda *given, function=function: function(*given)).lower(*args)
                began = time.perf_counter()
                programs[kind] = lowered.compile(options)
                made[kind].append(time.perf_counter() - began)
        for _ in range(CALLS):
            for kind, program in programs.items():
                began = time.perf_counter()
                jax.block_until_ready(program(*args))
                called[kind].append(1e3 * (time.perf_counter() - began))
        (a, b), (c, d) = ([float(np.median(found[kind])) for kind in OPTIONS] for found in (made, called))
        print(f"{name:38}{a:10.2f}{b:10.2f}{a / b:7.2f}{c:10.3f}{d:10.3f}{c / d:7.2f}")
        plain = name.replace(",", "").replace(" ", "_")
        figures |= {f"compile_without_emitters_{plain}": a / b, f"call_without_emitters_{plain}": c / d}
    return figures


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
