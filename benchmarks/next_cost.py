"""`python -m benchmarks.next_cost`: a short search of a population method on one plant after another, compiled in parts
and as one program of blocks.

Step responses of the steam chamber in four lengths, three constants each, 600 evaluations: as many costs, of which no
program but that of the method serves two. With nothing kept from before, in turns, in one process.
"""

import os
import tempfile
import time
from collections.abc import Mapping
from unittest import mock

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.problems import static_problem
from plantfit.optimize import minimise
from plantfit.optimize.loop import apart, generations, population_loop
from plantfit.recording.record import Recording, Signal
from plantfit.rig.steam_chamber import SteamChamberRig
from plantfit.study.objective import objective_of

METHODS, OPENINGS, BUDGET = ("cmaes", "pso", "jso"), ("opening10", "opening40", "opening70", "opening100"), 600


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: processor time of a later search in parts over that in blocks, by
    method."""
    steps = {n: r.recording for n, r in SteamChamberRig().records(1).items()}
    figures = {}
    print(f"{'s of processor time':24}{'first, blocks':>16}{'parts':>8}{'later, blocks':>16}{'parts':>8}{'ratio':>8}")
    for method in METHODS[:1] if quick else METHODS:
        blocks, parts = (_seconds(method, steps, in_parts) for in_parts in (False, True))
        later = [float(np.median(found[1:])) for found in (blocks, parts)]
        print(f"{method:24}{blocks[0]:16.2f}{parts[0]:8.2f}{later[0]:16.2f}{later[1]:8.2f}{later[1] / later[0]:8.2f}")
        figures[f"next_cost_{method}"] = later[1] / later[0]
    return figures


def _seconds(method: str, steps: Mapping[str, Recording], in_parts: bool) -> list[float]:
    """Processor time (s) of the searches one after the other."""
    for cached in (generations._compiled, apart._asking_and_telling, apart._evaluating):
        cached.cache_clear()
    found = []
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.dict(os.environ, {"PLANTFIT_CACHE": folder}),
        mock.patch.object(population_loop, "worth_it", return_value=in_parts),
    ):
        for k, opening in enumerate(OPENINGS):
            problem = static_problem({"step": _shifted(steps[opening], k)}, dead_time=0.3)
            objective = objective_of(problem)
            np.asarray(problem.costs(np.full((16, problem.space.dimension), 0.5)))  # the cost itself is compiled before
            began = time.process_time()
            minimise(objective, method, budget=BUDGET, seed=1)
            found.append(time.process_time() - began)
    return found


def _shifted(recording: Recording, by: int) -> Recording:
    """The record without its last samples, so that each has a length of its own."""
    n = len(recording.t) - by
    signals = {name: Signal(s.values[:n], s.unit) for name, s in recording.signals.items()}
    return Recording(recording.t[:n], signals, recording.name, recording.log)


if __name__ == "__main__":
    run(False)
