"""`python -m benchmarks.disturbance [--seeds 40] [--first-seed 300]`: a disturbance that wanders, and the parameters beside it.

Plants of `benchmarks.diagnosis` with noise of 1 % of the output's spread and a random walk on the output, of steps of 0.3, 1 and 3 times
the noise. Counted are the records in which it is told, the root of the mean square error of the parameters by least squares and beside
the disturbance (over their truth), and how often their stated 95 % intervals hold it. Then records with a fault of the model and none: how
often a disturbance is told of the model as it is, which would be false.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import PLANTS, write

NAMES = ("first", "second", "tanks")
SIZES = (0.3, 1.0, 3.0)  # steps a sample over noise
NOISE = 0.01


def record(plant: str, fault: str, seed: int, size: float = 0.0):
    """The problem of a plant with a fault, and a walk on its output."""
    from plantfit import Recording, Signal
    from plantfit.spec import load

    with tempfile.TemporaryDirectory() as place:
        problem = load(write(PLANTS[plant], fault, NOISE, seed, Path(place))).problem
    (name, e), (output,) = next(iter(problem.experiments.items())), problem.outputs
    y = e.recording[output]
    walk = size * NOISE * np.std(y) * np.cumsum(np.random.default_rng(10_000 + seed).standard_normal(len(y)))
    signals = {**e.recording.signals, output: Signal(y + walk, e.recording.signals[output].unit)}
    return problem.with_recordings({name: Recording(e.recording.t, signals, name)})


def told(problem):
    """The answer by least squares, and the fit beside a disturbance, None where none is told."""
    from plantfit import fit
    from plantfit.trust.diagnosis.catalogue import inside_kinds
    from plantfit.trust.diagnosis.plant.carrier import Carrier
    from plantfit.trust.diagnosis.plant.disturbance import disturbed
    from plantfit.trust.diagnosis.plant.hypothesis import fitted

    answer = fit(problem, budget=1500)
    carrier = Carrier.of(answer.problem, answer.best.x, inside_kinds(answer.problem))
    one = fitted(carrier, (), carrier.x, np.zeros(0), carrier.rows.fit)
    return answer, disturbed(carrier, one, carrier.rows.fit)


def run(seeds: int, first: int) -> None:
    """Print both tables."""
    heads = "plant", "steps over noise", "told", "parameters", "error, least squares", "error beside it", "intervals hold"
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for plant in NAMES:
        truth = PLANTS[plant].truth
        for size in SIZES:
            before, after, held = [], [], []
            for seed in range(first, first + seeds):
                answer, found = told(record(plant, "clean", seed, size))
                if found is not None:
                    pairs = [found.values[n] for n in truth]
                    before.append([answer.values[n] / t - 1.0 for n, t in truth.items()])
                    after.append([v / t - 1.0 for (v, _), t in zip(pairs, truth.values(), strict=True)])
                    held.append([abs(v - t) <= 1.96 * e for (v, e), t in zip(pairs, truth.values(), strict=True)])
            root = [" ".join(f"{100 * x:.1f}" for x in np.sqrt(np.mean(np.square(rows), axis=0))) for rows in (before, after)]
            share = " ".join(f"{100 * x:.0f}" for x in np.mean(held, axis=0))
            print(
                f"| {plant} | {size:g} | {len(held)} of {seeds} | {' '.join(truth)} | {root[0]} % | {root[1]} % | {share} % |", flush=True
            )
    print("\n| plant | records with a fault or none | a disturbance told |\n|---|---|---|")
    for plant in NAMES:
        faults = ["clean", "coloured", *PLANTS[plant].faults]
        found = [(f, s) for f in faults for s in range(first, first + max(seeds // 10, 1)) if told(record(plant, f, s))[1] is not None]
        print(f"| {plant} | {len(faults) * max(seeds // 10, 1)} | {len(found)} {found or ''} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=300)
    given = parser.parse_args()
    run(given.seeds, given.first_seed)
