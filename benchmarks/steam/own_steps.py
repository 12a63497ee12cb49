"""`python -m benchmarks.steam.own_steps`: adaptive steps beside the fewest equal steps of each opening that reach the
same error.

One candidate after another: the truth and 20 vectors even over the box. The time of equal steps is that of one step a
sample, times the mean number of steps over the samples of all openings.
"""

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.data import Steam, steam
from benchmarks.steam.accuracy import TARGET, candidates
from benchmarks.steam.interleaved import interleaved
from benchmarks.steam.ours import cube, problem
from benchmarks.steam.reference import reference
from plantfit.problem import Problem

import jax
import jax.numpy as jnp

FINENESS, FINEST = 16, 256


def run(repeats: int = 15) -> dict[str, float]:
    """Print the table and return the figures."""
    data = steam()
    adaptive, equal = problem(data, FINENESS, "adaptive"), {1: problem(data)}
    while max(equal) < FINEST:
        last = max(equal)
        equal[2 * last] = equal[last].with_simulator(equal[last].predictor.stepping().refined(2))
    print(
        f"{'vector':>8}{'steps a sample':>16}{'error':>12}{'adaptive':>10}{'error':>12} "
        "  (times in those of one step a sample)"
    )
    found = []
    for k, theta in enumerate(candidates(data)):
        exact, z = reference(data, theta), jnp.asarray(cube(equal[1], theta[None]))
        steps, reached = _fewest(data, equal, z, exact)
        error = float(np.max(_errors(data, adaptive, z, exact)))
        both = {
            n: (lambda p=p, z=z: jax.block_until_ready(p.compiled["costs"](z, p.arguments)))
            for n, p in ((0, adaptive), (1, equal[1]))
        }
        timings = interleaved({str(n): call for n, call in both.items()}, repeats)
        ratio = timings["0"].cpu / timings["1"].cpu
        found.append((steps, ratio, error))
        print(f"{'truth' if k == 0 else k:>8}{steps:16.2f}{reached:8.1e} bar{ratio:10.2f}{error:8.1e} bar", flush=True)
    steps, ratios, errors = np.array(found).T
    figures = {
        "truth": ratios[0],
        "random": float(np.mean(ratios[1:])),
        "equal": float(np.mean(steps[1:])),
        "error": float(np.max(errors)),
    }
    print(
        f"at the truth {ratios[0]:.2f}; at random vectors {figures['random']:.2f} in the mean, equal steps "
        f"{figures['equal']:.2f}"
    )
    return figures


def _fewest(data: Steam, equal: dict[int, Problem], z: jax.Array, exact: np.ndarray) -> tuple[float, float]:
    """The mean number of steps a sample, each opening with the fewest that keep its error under TARGET, and the
    largest error."""
    errors = {n: _errors(data, p, z, exact) for n, p in equal.items()}
    fewest = [min((n for n in equal if errors[n][i] < TARGET), default=FINEST) for i in range(len(data.samples))]
    return float(np.average(fewest, weights=data.samples)), max(float(errors[n][i]) for i, n in enumerate(fewest))


def _errors(data: Steam, of: Problem, z: jax.Array, exact: np.ndarray) -> np.ndarray:
    """The largest of each opening, bar."""
    values = of.space.physical(z[0])
    return np.array(
        [np.max(np.abs(of.predict(values, f"opening{i}")["y"][1:] - exact[i, :n])) for i, n in enumerate(data.samples)]
    )


if __name__ == "__main__":
    run()
