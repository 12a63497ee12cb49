"""One form of controller searched over plants: a fast loop that keeps what is asked for on all of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import STEEPNESS, Demand
from plantfit.control.tune.forms import Form
from plantfit.control.tune.loop_scores import Judge, Program, scores_of
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SearchError
from plantfit.optimize import Objective, minimise
from plantfit.optimize.contract import CostOfData
from plantfit.optimize.loop.population_loop import LANES

import jax
import jax.numpy as jnp

TAIL = 0.5  # of the plants that may miss a limit: the worst that the search looks at, so that fresh ones miss it no more often
ROOM = 0.95  # of a limit: what the search keeps, so that plants that it has not seen keep the limit


@dataclass(frozen=True, eq=False)
class Search:
    """Controllers of a form over the plants of `judge`, whose sampled responses are `h` (n, F) at w (F,); `sizes` are the IAE of step and
    load that costs are counted in."""

    judge: Judge
    h: np.ndarray
    w: np.ndarray
    wishes: Wishes
    form: Form
    sizes: tuple[float, float]

    def on_best_fit(self) -> "Search":
        """The same on the first plant alone."""
        return replace(self, judge=self.judge.part(slice(0, 1)), h=self.h[:1])

    def found(self, starts: np.ndarray, budget: int, seed: int, progress: Callable[[Any], None] | None) -> np.ndarray:
        """The point (d,) of the cube of least cost; `starts` (k, d) are tried too. Raises SearchError where none keeps all loops finite."""
        form = self.form
        costs = CostOfData(_costs_of(self.judge.program, form.build, form.response, TAIL * (1.0 - self.wishes.share)), self._data())
        first = _in_rows(costs, starts)
        best = starts[np.argsort(first)[:1]]
        runs = minimise(Objective(form.space.dimension, costs, start=best), "cmaes", budget=budget, runs=1, seed=seed, progress=progress)
        run = min(runs, key=lambda r: r.cost)
        if min(run.cost, np.min(first)) >= 1e5:
            raise SearchError(
                f"No {form.name} within the bounds of the search keeps the loops of all plants finite; give a longer period or "
                "wider limits, or measure again."
            )
        return np.asarray(run.x if run.cost < np.min(first) else best[0])

    def _data(self) -> dict[str, Any]:
        """All numbers that costs are made of."""
        wishes, weights = self.wishes, np.gradient(self.w) / np.pi * self.wishes.period
        limits = {
            "overshoot": ROOM * wishes.overshoot, "ms": 1.0 + ROOM * (wishes.ms - 1.0), "moved": wishes.input_noise,
            "outside": ROOM * wishes.tolerated, "left": wishes.settled,
        }  # fmt: skip
        found = {
            "loop": self.judge.data(), "form": self.form.data, "h": self.h, "w": self.w, "weights": weights, "sizes": self.sizes,
            "limits": limits, "noise": wishes.noise / (wishes.upper - wishes.lower),
        }  # fmt: skip
        return jax.tree.map(jnp.asarray, found)


def _in_rows(costs: CostOfData, points: np.ndarray) -> np.ndarray:
    """Costs (k,) of points (k, d), as many at a time as in the search, so that nothing is compiled for their number."""
    padded = np.concatenate([points, np.repeat(points[:1], -len(points) % LANES, axis=0)])
    found = [np.asarray(costs(jnp.asarray(padded[k : k + LANES]))) for k in range(0, len(padded), LANES)]
    return np.concatenate(found)[: len(points)]


@lru_cache(maxsize=32)
def _costs_of(program: Program, build: Callable[[Any, Any], Any], respond: Callable[..., Any], share: float) -> Callable[[Any, Any], Any]:
    """The cost of points (n, d) of the cube, given `Search._data`; one identity for a choice, so that it is compiled once."""
    demand = Demand(share=share, mean=0.5)

    def over(value, limit):
        return STEEPNESS * jnp.maximum(value / limit - 1.0, 0.0)

    @jax.jit
    def costs(zs, data):
        h, w, limits, sizes = data["h"], data["w"], data["limits"], data["sizes"]
        controllers = jax.vmap(lambda z: build(z, data["form"]))(zs)
        scores = scores_of(program, controllers, data["loop"])

        def response(parameters):
            c = respond(parameters, w, jnp)
            return 1.0 / (1.0 + c * h), c

        s, c = jax.vmap(response)(controllers)
        ms = jnp.max(jnp.abs(s), axis=-1)
        moved = data["noise"] * jnp.sqrt(jnp.sum(jnp.abs(c[:, None] * s) ** 2 * data["weights"], axis=-1))
        cost = 0.5 * (scores.iae / sizes[0] + scores.load_iae / sizes[1])
        cost = cost * (1.0 + over(scores.overshoot, limits["overshoot"]) + over(ms, limits["ms"]) + over(moved, limits["moved"]))
        cost = cost * (1.0 + over(scores.outside, limits["outside"]))
        cost = cost * (1.0 + STEEPNESS * jnp.maximum(scores.left - limits["left"], 0.0))
        return demand.over_plants(jnp.where(jnp.isfinite(cost), cost, 1e6))

    return costs
