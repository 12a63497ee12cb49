"""`python -m benchmarks.substeps_of_tables`: substeps of a model that reads tables, as a loop and written out.

Programs of the steam chamber (two openings, 8 steps a sample) are traced and compiled anew in turns, with XLA's cache
off, and called in turns. Seconds and milliseconds are processor time of this process, so that other work counts little;
the ratios are those of medians.
"""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from plantfit.cases.steam.dynamic_runs import finely
from plantfit.cases.steam.problems import dynamic_problem
from plantfit.problem.problem import Problem
from plantfit.rig.steam_chamber import SteamChamberRig
from plantfit.runtime import compiler_options
from plantfit.simulate.steps import intervals

import jax

TURNS, CALLS, STEPS, CANDIDATES = 3, 60, 8, 20
MOST = {"loop": 1, "written": intervals.UNROLLED}


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: a loop over what is written out, to make and to call."""
    jax.config.update("jax_enable_compilation_cache", False)
    figures: dict[str, float] = {}
    print(
        f"{'program':24}{'made, s: loop':>15}{'written':>9}{'ratio':>7}{'call, ms: loop':>16}{'written':>9}{'ratio':>7}"
    )
    for name in ("residuals", "residuals_and_jacobian", "costs"):
        made: dict[str, list[float]] = {kind: [] for kind in MOST}
        called: dict[str, list[float]] = {kind: [] for kind in MOST}
        ready: dict[str, Callable] = {}
        for _ in range(1 if quick else TURNS):
            for kind, most in MOST.items():
                with _written_out(most):
                    problem = _problem()
                    z = np.random.default_rng(1).random((CANDIDATES, problem.space.dimension))
                    given = z if name == "costs" else z[0], problem.arguments
                    function = problem.compiled[name].__wrapped__  # its first call is neither kept nor found
                    began = time.process_time()
                    lowered = jax.jit(lambda *a, function=function: function(*a)).lower(*given)
                    program = lowered.compile(compiler_options())
                    made[kind].append(time.process_time() - began)
                    ready[kind] = lambda program=program, given=given: program(*given)
        for _ in range(CALLS):
            for kind, call in ready.items():
                began = time.process_time()
                jax.block_until_ready(call())
                called[kind].append(1e3 * (time.process_time() - began))
        makes, calls = ({kind: float(np.median(found[kind])) for kind in MOST} for found in (made, called))
        ratios = makes["loop"] / makes["written"], calls["loop"] / calls["written"]
        print(
            f"{name:24}{makes['loop']:15.2f}{makes['written']:9.2f}{ratios[0]:7.2f}"
            f"{calls['loop']:16.2f}{calls['written']:9.2f}{ratios[1]:7.2f}",
            flush=True,
        )
        figures |= {f"made_{name}": ratios[0], f"call_{name}": ratios[1]}
    return figures


@contextmanager
def _written_out(most: int) -> Generator[None]:
    with patch.object(intervals, "UNROLLED_TABLES", most):
        yield


def _problem() -> Problem:
    """Built anew, so that nothing of it has been traced."""
    rig = SteamChamberRig()
    made = {(r := rig.record(u, 2, seconds)).recording.name: r.recording for u, seconds in ((60, 8.0), (100, 6.0))}
    return finely(dynamic_problem(made), STEPS)


if __name__ == "__main__":
    run(False)
