"""`python -m benchmarks.gain_search [--plants "lag 10 s, dead time 2 s;four lags of 5 s"] [--seeds 3] [--no-longer]`:
how near `plantfit tune` comes to the best PID, on the best fit alone and on all plants.

Eight plants, each with 80 more whose parameters scatter by 5 % (3 % of the swinging one). Printed is what the search
made small, SIMC on the best fit being 1 without its penalties, for several seeds with the default budget, and for one
search ten times as long; the time of the search on the best fit over that on all plants, programs compiled before.
"""

import argparse
import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.loop_design import NEAR, PAIR, on_one_plant
from plantfit.models.text.equations import equations

BUDGET, LONGER, PLANTS = 400, 10, 80
LAG = "x' = (K*delay(u, L) - x)/tau\ny = x"
TWO = "w' = (K*delay(u, L) - w)/tau\nx' = (w - x)/T\ny = x"
RISING = "w' = (K*delay(u, L) - w)/tau\nx' = w\ny = x"
SWINGING = "v' = K*u - 2*d*w*v - w^2*x\nx' = v\ny = x"
OTHER_WAY = "w' = (K*u - w)/tau\nx' = (w - x)/T\ny = x - Z*(w - x)/T"
FOUR = "a' = (K*u - a)/tau\nb' = (a - b)/tau\nc' = (b - c)/tau\nx' = (c - x)/tau\ny = x"


class Plant(NamedTuple):
    """Equations, values, period and load; states are all but the output."""

    text: str
    values: Mapping[str, float]
    period: float
    states: str = "x"
    scatter: float = 0.05


CASES = {
    "lag 10 s, dead time 2 s": Plant(LAG, {"K": 2.0, "tau": 10.0, "L": 2.0}, 0.5),
    "lag 50 s, dead time 1 s": Plant(LAG, {"K": 2.0, "tau": 50.0, "L": 1.0}, 0.5),
    "lag 2 s, dead time 10 s": Plant(LAG, {"K": 1.0, "tau": 2.0, "L": 10.0}, 0.5),
    "lags 10 and 5 s, dead time 1 s": Plant(TWO, {"K": 2.0, "tau": 10.0, "T": 5.0, "L": 1.0}, 0.5, "wx"),
    "integrator, lag 3 s, dead time 1 s": Plant(RISING, {"K": 0.5, "tau": 3.0, "L": 1.0}, 0.25, "wx"),
    "swinging, damping 0.3": Plant(SWINGING, {"K": 1.0, "d": 0.3, "w": 1.0}, 0.1, "vx", 0.03),
    "two lags, first the other way": Plant(OTHER_WAY, {"K": 2.0, "tau": 5.0, "T": 10.0, "Z": 1.0}, 0.5, "wx"),
    "four lags of 5 s": Plant(FOUR, {"K": 2.0, "tau": 5.0}, 0.5, "abcx"),
}


def family(plant: Plant, n: int, seed: int) -> OneLoop:
    """The best fit, then n draws."""
    model = equations(
        plant.text, inputs=["u"], states=list(plant.states), outputs=["y"], parameters=list(plant.values), name="plant"
    )
    rng = np.random.default_rng(seed)
    draws = {k: np.r_[v, v * np.exp(plant.scatter * rng.normal(size=n))] for k, v in plant.values.items()}
    return OneLoop(model, "y", "u", {}, draws)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", default=";".join(CASES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--no-longer", action="store_true")
    given = parser.parse_args()
    print(f"{'':36}{'best fit alone':>24}{'longer':>9}{'all plants':>26}{'longer':>9}{'time':>7}")
    for name in given.plants.split(";"):
        plant = CASES[name.strip()]
        wishes = Wishes(5.0, 2.0, 0.5, plant.period, -20.0, 20.0, noise=0.01)
        search = tuned_loop(family(plant, PLANTS, 1), family(plant, 20, 2), wishes, budget=16).search
        assert search is not None
        single, starts = search.on_best_fit(), search.form.starts

        def searched(seed: int, times: int = 1, single=single, search=search, starts=starts):
            began = time.perf_counter()
            alone = on_one_plant(single, starts, times * BUDGET, seed, None)
            between = time.perf_counter()
            every = search.found(np.r_[starts, alone[None]], times * PAIR * BUDGET, seed + 1, None, NEAR)
            took = (between - began) / (time.perf_counter() - between)
            best = single.best_of(np.stack([alone, every]))
            return float(single.cost(best[None])[0]), float(search.cost(every[None])[0]), took

        searched(1)  # compiled
        found = [searched(seed) for seed in range(1, 1 + given.seeds)]
        longer = None if given.no_longer else searched(1, LONGER)
        alone, every = (", ".join(f"{f[k]:.3f}" for f in found) for k in (0, 1))
        ends = ["" if longer is None else f"{longer[k]:.3f}" for k in (0, 1)]
        times = float(np.median([f[2] for f in found]))
        print(f"{name.strip():36}{alone:>24}{ends[0]:>9}{every:>26}{ends[1]:>9}{times:7.2f}", flush=True)


if __name__ == "__main__":
    main()
