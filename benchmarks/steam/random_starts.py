"""Ten runs with exact derivatives from random starts, on two processes: the seconds, and the costs over the noise
floor."""

import argparse
import multiprocessing
import os
import time

BUDGET = {"least_squares": 10_000, "lbfgsb": 60_000}
RUNS, PROCESSES = 10, 2
NOISE_SEED, FIRST_SEED = 5, 100


def _runs(method: str, seeds: list[int]) -> list[float]:
    """Final costs over the floor, run by run."""
    # imported here: each process holds one thread
    from benchmarks.steam.weighted import FLOOR, record, weighted
    from plantfit.optimize import minimise
    from plantfit.study.objective import objective_of

    objective = objective_of(weighted(record(NOISE_SEED)))
    return [minimise(objective, method, runs=1, budget=BUDGET[method], seed=seed)[0].cost / FLOOR for seed in seeds]


def main() -> None:
    """Print the costs and the seconds from start to end, compilation included."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", choices=BUDGET, default="least_squares")
    method = parser.parse_args().method
    seeds = [[FIRST_SEED + k for k in range(p, RUNS, PROCESSES)] for p in range(PROCESSES)]
    os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")  # one thread for each process
    started, used = time.perf_counter(), os.times()
    with multiprocessing.get_context("spawn").Pool(PROCESSES) as pool:
        costs = sorted(c for found in pool.starmap(_runs, [(method, s) for s in seeds]) for c in found)
        pool.close()
        pool.join()
    spent = os.times()
    cpu = spent.children_user + spent.children_system - used.children_user - used.children_system
    print(f"{method}: {RUNS} random starts, final costs over the noise floor {', '.join(f'{c:.4f}' for c in costs)}")
    print(f"{time.perf_counter() - started:.0f} s on {PROCESSES} processes, {cpu:.0f} CPU s")


if __name__ == "__main__":
    main()
