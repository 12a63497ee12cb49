"""A descent of workload D's ten openings to its end, with all openings simulated at every step or only those that still
move.

    python -m benchmarks.steam.last_descents

Both ways alternate in one process and must end in the same bits; the ratio is that of processor time. The searches
begin where one of 10 000 evaluations from a random start has ended, as the last descents of `plantfit run` do, there
with the finer steps of the answer.
"""

import dataclasses
import time

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.steam.weighted import record, weighted
from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective
from plantfit.optimize.local.separable import separable_least_squares
from plantfit.optimize.loop.counter import Counter
from plantfit.study.objective import objective_of

NOISE_SEED, SEED = 5, 100
STEPS, FINER, PAIRS = 200, 4, 3


def run(pairs: int = PAIRS) -> dict[str, float]:
    """Print and return how many times the processor time falls, and the share of openings that move."""
    problem = weighted(record(NOISE_SEED))
    [found] = minimise(objective_of(problem), "least_squares", runs=1, budget=10_000, seed=SEED)
    finer = objective_of(problem.with_simulator(problem.predictor.stepping().refined(FINER)))
    assert finer.blocks is not None
    blocks, asked = finer.blocks, []

    def seen(x: np.ndarray, wanted: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        asked.append(np.mean(wanted))
        return blocks(x, wanted)

    moving = dataclasses.replace(finer, blocks=seen)
    every = dataclasses.replace(finer, blocks=lambda x, wanted: blocks(x, np.ones_like(wanted)))
    times, ends = [], set()
    for k in range(pairs + 1):  # the first pair compiles
        both = []
        for objective in (every, moving) if k % 2 else (moving, every):
            seconds, end = _descent(objective, found.x)
            both.append((objective is every, seconds))
            ends.add(end)
        times.append([seconds for _, seconds in sorted(both, reverse=True)])
    if len(ends) != 1:
        raise SystemExit("The two ways do not end in the same bits.")
    whole, part = np.array(times[1:]).T
    ratio = float(np.median(whole / part))
    print(
        f"descents of at most {STEPS} steps: {np.median(whole):.1f} s with all openings, {np.median(part):.1f} "
        f"s with those that move ({100 * np.mean(asked):.0f} %), {ratio:.1f} times less; same bits"
    )
    return {"last_descents": ratio, "last_descents_moving": float(np.mean(asked))}


def _descent(objective: Objective, x: np.ndarray) -> tuple[float, bytes]:
    """Seconds of the processor, and the bits of the end."""
    counter, began = Counter(objective, 1e9), time.process_time()
    separable_least_squares(counter, x, agree=1, max_steps=STEPS)
    return time.process_time() - began, counter.best_x.tobytes()


if __name__ == "__main__":
    run()
