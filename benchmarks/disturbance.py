"""`python -m benchmarks.disturbance [--seeds 40] [--first-seed 300]`: what nobody measured on an output, and the
parameters beside it.

Plants of `benchmarks.diagnosis` with noise of 1 % of the output's spread and, on the output, a random walk with steps
of 0.3, 1 and 3 times the noise, or three sines with periods of 0.35, 0.6 and 1.1 of the record, together of 3, 5 and 20
times the noise. Counted are the records in which it is told, the root of the mean square error of the parameters by
least squares and beside it (over their truth), and how often their stated 95 % intervals hold it. Then records with a
fault of the model and none: how often one is told of the model as it is, before any addition is tried; of an offset and
a drift of one rate that is not false, of others it is.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import PLANTS, write

NAMES = ("first", "second", "tanks")
SIZES = (0.3, 1.0, 3.0)  # steps a sample over noise
NOISE, PERIODS = 0.01, (0.35, 0.6, 1.1)
SLOW = (3.0, 5.0, 20.0)  # size of slow sines over noise


def record(plant: str, fault: str, seed: int, size: float = 0.0, slow: bool = False):
    """The problem of a plant with a fault, and a walk or slow sines on its output."""
    from plantfit import Recording, Signal
    from plantfit.spec import load

    with tempfile.TemporaryDirectory() as place:
        problem = load(write(PLANTS[plant], fault, NOISE, seed, Path(place))).problem
    (name, e), (output,) = next(iter(problem.experiments.items())), problem.outputs
    y = e.recording[output]
    t, rng = e.recording.t, np.random.default_rng(10_000 + seed)
    sines = sum(np.sin(2 * np.pi * t / (p * np.ptp(t)) + rng.uniform(0, 2 * np.pi)) for p in PERIODS) / np.sqrt(
        len(PERIODS) / 2
    )
    added = size * NOISE * np.std(y) * (sines if slow else np.cumsum(rng.standard_normal(len(y))))
    signals = {**e.recording.signals, output: Signal(y + added, e.recording.signals[output].unit)}
    return problem.with_recordings({name: Recording(e.recording.t, signals, name)})


def told(problem, slow: bool = False):
    """The answer by least squares, and the fit beside what is told, None where nothing is."""
    from plantfit import fit
    from plantfit.trust.diagnosis.catalogue import inside_kinds
    from plantfit.trust.diagnosis.judge import times_noise
    from plantfit.trust.diagnosis.plant.carrier import Carrier
    from plantfit.trust.diagnosis.plant.disturbance import disturbed
    from plantfit.trust.diagnosis.plant.hypothesis import fitted
    from plantfit.trust.diagnosis.plant.slow_drift import drifting
    from plantfit.trust.diagnosis.plant.unmeasured import SOME

    answer = fit(problem, budget=1500)
    carrier = Carrier.of(answer.problem, answer.best.x, inside_kinds(answer.problem))
    use = carrier.rows.fit
    one = fitted(carrier, (), carrier.x, np.zeros(0), use)
    if slow and times_noise(carrier, one, ~use & use) <= SOME:
        return answer, None
    return answer, drifting(carrier, one, problem.outputs, use) if slow else disturbed(carrier, one, use)


def run(seeds: int, first: int) -> None:
    """Print all tables."""
    for slow, sizes in ((False, SIZES), (True, SLOW)):
        of = "slow sines over noise" if slow else "steps over noise"
        heads = "plant", of, "told", "parameters", "error, least squares", "error beside it", "intervals hold"
        print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
        for plant in NAMES:
            truth = PLANTS[plant].truth
            for size in sizes:
                before, after, held = [], [], []
                for seed in range(first, first + seeds):
                    answer, found = told(record(plant, "clean", seed, size, slow), slow)
                    if found is not None:
                        pairs = [found.values[n] for n in truth]
                        before.append([answer.values[n] / t - 1.0 for n, t in truth.items()])
                        after.append([v / t - 1.0 for (v, _), t in zip(pairs, truth.values(), strict=True)])
                        held.append([abs(v - t) <= 1.96 * e for (v, e), t in zip(pairs, truth.values(), strict=True)])
                root = [
                    " ".join(f"{100 * x:.1f}" for x in np.sqrt(np.mean(np.square(rows), axis=0)))
                    for rows in (before, after)
                ]
                share = " ".join(f"{100 * x:.0f}" for x in np.mean(held, axis=0))
                print(
                    f"| {plant} | {size:g} | {len(held)} of {seeds} | "
                    f"{' '.join(truth)} | {root[0]} % | {root[1]} % | {share} % |",
                    flush=True,
                )
        what = "a slow drift" if slow else "a disturbance that wanders"
        print(f"\n| plant | records with a fault or none | {what} told |\n|---|---|---|")
        for plant in NAMES:
            faults, own = ["clean", "coloured", *PLANTS[plant].faults], range(first, first + max(seeds // 10, 1))
            found = [(f, s) for f in faults for s in own if told(record(plant, f, s), slow)[1] is not None]
            print(f"| {plant} | {len(faults) * len(own)} | {len(found)} {found or ''} |", flush=True)
        print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=300)
    given = parser.parse_args()
    run(given.seeds, given.first_seed)
