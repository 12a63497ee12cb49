"""One form of controller searched over plants: a fast loop that keeps what is asked for on all of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import STEEPNESS, Demand
from plantfit.control.tune.forms import Form
from plantfit.control.tune.loop_scores import Judge
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SearchError
from plantfit.optimize import Objective, minimise

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
        form, wishes, sizes = self.form, self.wishes, self.sizes
        demand = Demand(share=TAIL * (1.0 - wishes.share), mean=0.5)
        h, w = jnp.asarray(self.h), jnp.asarray(self.w)
        weights = np.gradient(self.w) / np.pi * wishes.period
        ms_limit = 1.0 + ROOM * (wishes.ms - 1.0)

        def over(value, limit):
            return STEEPNESS * jnp.maximum(value / limit - 1.0, 0.0)

        @jax.jit
        def costs(zs):
            controllers = jax.vmap(form.made)(zs)
            scores = self.judge.scores(controllers)

            def response(parameters):
                c = form.response(parameters, w, jnp)
                return 1.0 / (1.0 + c * h), c

            s, c = jax.vmap(response)(controllers)
            ms = jnp.max(jnp.abs(s), axis=-1)
            moved = wishes.noise * jnp.sqrt(jnp.sum(jnp.abs(c[:, None] * s) ** 2 * weights, axis=-1)) / (wishes.upper - wishes.lower)
            cost = 0.5 * (scores.iae / sizes[0] + scores.load_iae / sizes[1])
            cost = cost * (1.0 + over(scores.overshoot, ROOM * wishes.overshoot) + over(ms, ms_limit) + over(moved, wishes.input_noise))
            cost = cost * (1.0 + over(scores.outside, ROOM * wishes.tolerated))
            cost = cost * (1.0 + STEEPNESS * jnp.maximum(scores.left - wishes.settled, 0.0))
            return demand.over_plants(jnp.where(jnp.isfinite(cost), cost, 1e6))

        first = np.asarray(costs(starts))
        best = starts[np.argsort(first)[:1]]
        runs = minimise(Objective(form.space.dimension, costs, start=best), "cmaes", budget=budget, runs=1, seed=seed, progress=progress)
        run = min(runs, key=lambda r: r.cost)
        if min(run.cost, np.min(first)) >= 1e5:
            raise SearchError(
                f"No {form.name} within the bounds of the search keeps the loops of all plants finite; give a longer period or "
                "wider limits, or measure again."
            )
        return np.asarray(run.x if run.cost < np.min(first) else best[0])
