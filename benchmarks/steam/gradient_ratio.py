"""How many evaluations derivatives cost on workload S: cost and derivative alternate, so that a busy machine slows both
alike.

Processor time of this process, which has one thread: what other programs take of the machine meanwhile is not in it.
"""

import time
from collections.abc import Callable

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.data import steam
from benchmarks.steam.ours import cube, problem

import jax
import jax.numpy as jnp

PAIRS = 150


def run() -> dict[str, float]:
    """Print and return the medians of derivative over evaluation, of the gradient of 20, of one, and of the block
    Jacobian."""
    data = steam()
    whole = problem(data)
    compiled, arguments = whole.compiled, whole.arguments
    several = jnp.asarray(cube(whole, data.draw(20, 5)))
    one, point = several[:1], several[0]
    pairs: dict[str, tuple[Callable, Callable]] = {
        "gradients of 20": (
            lambda: compiled["costs"](several, arguments),
            lambda: compiled["values_and_gradients"](several, arguments),
        ),
        "gradient of one": (
            lambda: compiled["costs"](one, arguments),
            lambda: compiled["values_and_gradients"](one, arguments),
        ),
        "block Jacobian": (lambda: compiled["costs"](one, arguments), lambda: compiled["blocks"](point, arguments)),
    }
    found = {}
    for name, (cost, derivative) in pairs.items():
        times = np.array([[_seconds(f) for f in (cost, derivative)] for _ in range(PAIRS)])[3:]
        found[name] = float(np.median(times[:, 1] / times[:, 0]))
        print(f"{name:16} {found[name]:6.2f} evaluations ({1e3 * np.median(times[:, 1]):.2f} ms)")
    return found


def _seconds(call: Callable) -> float:
    started = time.process_time()
    jax.block_until_ready(call())
    return time.process_time() - started


if __name__ == "__main__":
    run()
