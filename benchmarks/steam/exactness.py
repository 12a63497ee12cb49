"""`python -m benchmarks.steam.exactness`: steps a sample that plantfit needs, opening by opening, for 1e-3 bar at 21
vectors of the box."""

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.data import steam
from benchmarks.steam.accuracy import TARGET, candidates
from benchmarks.steam.ours import cube, problem
from benchmarks.steam.reference import reference

FINEST = 256


def run() -> None:
    """Refine by doubling against Radau, as `plantfit check --verify --tolerance` does, and print the largest errors
    that remain."""
    data = steam()
    plain = problem(data, substeps=1)
    variants = {1: plain}
    while max(variants) < FINEST:
        last = max(variants)
        variants[2 * last] = variants[last].with_simulator(variants[last].predictor.stepping().refined(2))
    print(f"{'vector':>8}{'steps a sample, by opening':>50}{'largest error':>16}")
    worst = 0.0
    for k, theta in enumerate(candidates(data)):
        exact, values = reference(data, theta), plain.space.physical(cube(plain, theta[None])[0])
        steps, errors = [], []
        for i, n in enumerate(data.samples):
            for substeps, variant in variants.items():
                y = variant.predict(values, f"opening{i}")["y"][1:]
                error = float(np.max(np.abs(y - exact[i, :n])))
                if error < TARGET or substeps == FINEST:
                    break
            steps.append(substeps)
            errors.append(error)  # pyrefly: ignore[unbound-name]  (there is a variant)
        worst = max(worst, *errors)
        print(f"{'truth' if k == 0 else k:>8}{' '.join(map(str, steps)):>50}{max(errors):12.1e} bar", flush=True)
    print(f"largest error of all: {worst:.1e} bar")


if __name__ == "__main__":
    run()
