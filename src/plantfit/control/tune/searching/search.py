"""One form of controller searched over plants: a fast loop that keeps what is asked for on all of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import STEEPNESS, Demand
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.frequency import margins_in_search, noise_at_input, open_loop, outer_loop
from plantfit.control.tune.loop_scores import Judge, Program, scores_of
from plantfit.control.tune.searching.figures import figure
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SearchError, Status
from plantfit.optimize import Objective, minimise
from plantfit.optimize.algorithms.cma_es.cmaes import CmaEs
from plantfit.optimize.contract import CostOfData, Facts, Needs
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.generations import LANES
from plantfit.optimize.loop.nested import Nested

import jax
import jax.numpy as jnp

# of the plants that may miss a limit: the worst that the search looks at, so that fresh ones miss it no more often
TAIL = 0.5
AUGMENTED = (
    0.02  # how much the sum of the figures counts beside the worst of them, so that no point of a front is dominated
)
ROOM = 0.95  # of a limit: what the search keeps, so that plants that it has not seen keep the limit


@dataclass(frozen=True, eq=False)
class Search:
    """Controllers of a form over the plants of `judge`, whose sampled responses are `h` (n, F) at w (F,); `sizes`
    are what figures are counted in, `weights` those that are made small, by name, their shares."""

    judge: Judge
    h: np.ndarray
    w: np.ndarray
    wishes: Wishes
    form: Form
    sizes: Mapping[str, float]
    weights: Mapping[str, float]

    def on_best_fit(self) -> "Search":
        """The same on the first plant alone."""
        return replace(self, judge=self.judge.part(slice(0, 1)), h=self.h[:1])

    def found(self, starts: np.ndarray, budget: int, seed: int, progress: Callable[[Any], None] | None) -> np.ndarray:
        """The point (d,) of the cube of least cost; `starts` (k, d) are tried too. Raises SearchError where none
        keeps all loops finite."""
        return self._least(self._costs(False), starts, budget, seed, progress)

    def nearest(
        self, goal: "Goal", starts: np.ndarray, budget: int, seed: int, progress: Callable[[Any], None] | None
    ) -> np.ndarray:
        """The point of the cube whose worst figure, counted by `goal`, is least (augmented Chebyshev)."""
        return self._least(self._costs(True, goal), starts, budget, seed, progress)

    def figures(self, points: np.ndarray) -> np.ndarray:
        """The figures (k, m) of points (k, d) over all plants, those of `weights`, with what they miss limits by."""
        ones = np.ones(len(self.weights))
        found = [self._costs(True, Goal(0.0 * ones, ones, np.eye(len(ones))[i])) for i in range(len(ones))]
        return np.stack([_in_rows(costs, points) for costs in found], axis=1)

    def _least(
        self, costs: CostOfData, starts: np.ndarray, budget: int, seed: int, progress: Callable[[Any], None] | None
    ) -> np.ndarray:
        form = self.form
        first = _in_rows(costs, starts)
        best = starts[np.argsort(first)[:1]]
        runs = minimise(
            Objective(form.space.dimension, costs, start=best),
            _Cmaes(),
            budget=budget,
            runs=1,
            seed=seed,
            progress=progress,
        )
        run = min(runs, key=lambda r: r.cost)
        if min(run.cost, np.min(first)) >= 1e5:
            raise SearchError(
                f"No {form.name} within the bounds of the search keeps the loops of all "
                "plants finite; give a longer period or wider limits, or measure again."
            )
        return np.asarray(run.x if run.cost < np.min(first) else best[0])

    def _costs(self, front: bool, goal: "Goal | None" = None) -> CostOfData:
        wishes, program = self.wishes, self.judge.program
        limited = tuple(n for n, given in EXTRA.items() if given(wishes))
        demand = demand_of(wishes)
        function = _costs_of(program, self.form.build, self.form.response, demand, tuple(self.weights), limited, front)
        return CostOfData(function, self._data(goal))

    def _data(self, goal: "Goal | None") -> dict[str, Any]:
        """All numbers that costs are made of."""
        wishes, weights = self.wishes, np.gradient(self.w) / np.pi * self.wishes.period
        limits = {
            "overshoot": ROOM * wishes.overshoot, "ms": 1.0 + ROOM * (wishes.ms - 1.0), "moved": wishes.input_noise,
            "outside": ROOM * wishes.tolerated, "left": wishes.settled,
            "settling": ROOM * wishes.settling if EXTRA["settling"](wishes) else 1.0,
            "travel": ROOM * wishes.travel if EXTRA["travel"](wishes) else 1.0,
            "gain": 1.0 + (wishes.gain_margin - 1.0) / ROOM, "phase": wishes.phase_margin / ROOM,
        }  # fmt: skip
        shares = np.array(list(self.weights.values()))
        found = {
            "loop": self.judge.data(), "form": self.form.data, "h": self.h, "w": self.w, "weights": weights,
            "sizes": {n: self.sizes[n] for n in self.weights}, "shares": shares,
            "half": 0.5 * self.judge.course.seconds,
            "limits": limits, "noise": noises(wishes, self.form.inner),
        }  # fmt: skip
        if goal is not None:
            found["goal"] = (goal.ideal, goal.spread, goal.shares)
        return jax.tree.map(jnp.asarray, found)


@dataclass(frozen=True)
class _Cmaes:
    """`cmaes` driven from outside of the compiled program: a loop over plants takes seconds to compile, and so it is
    compiled once for the search and for points on their own, and the method once for all loops."""

    needs: ClassVar[Needs] = CmaEs.needs

    def run(self, key: Any, objective: Objective, budget: int, counter: Counter) -> Status:
        facts = Facts(objective.dimension, budget, objective.lower, objective.upper, objective.start)
        population = Nested(CmaEs(), facts, key)
        while not population.stopped:
            population.generation(counter)
        return Status.converged


@dataclass(frozen=True, eq=False)
class Goal:
    """Where on a front a search goes: figures (m,) are counted as (figure - ideal) / spread, times their `shares`."""

    ideal: np.ndarray
    spread: np.ndarray
    shares: np.ndarray


EXTRA: dict[str, Callable[[Wishes], bool]] = {
    "settling": lambda w: bool(np.isfinite(w.settling)), "travel": lambda w: bool(np.isfinite(w.travel)),
    "gain": lambda w: w.gain_margin > 1.0, "phase": lambda w: w.phase_margin > 0.0,
}  # fmt: skip
"""Limits that a search looks at only where they are asked for."""


def demand_of(wishes: Wishes) -> Demand:
    """How costs of plants are put together."""
    if wishes.over == "chance":
        return Demand(share=TAIL * (1.0 - wishes.share), mean=0.5)
    return Demand(share=1.0 if wishes.over == "expected" else 0.0)


def noises(wishes: Wishes, inner: bool) -> Any:
    """Standard deviations of the measurements' noise over the range of the input: of the output, with an inner one
    of both (2,)."""
    span = wishes.upper - wishes.lower
    return np.array([wishes.noise, wishes.inner_noise]) / span if inner else wishes.noise / span


def _in_rows(costs: CostOfData, points: np.ndarray) -> np.ndarray:
    """Costs (k,) of points (k, d), as many at a time as in the search, so that nothing is compiled for their number."""
    padded = np.concatenate([points, np.repeat(points[:1], -len(points) % LANES, axis=0)])
    found = [np.asarray(costs(jnp.asarray(padded[k : k + LANES]))) for k in range(0, len(padded), LANES)]
    return np.concatenate(found)[: len(points)]


@lru_cache(maxsize=32)
def _costs_of(
    program: Program, build: Callable[[Any, Any], Any], respond: Callable[..., Any], demand: Demand,
    figures: tuple[str, ...],
    limited: tuple[str, ...], front: bool,
) -> Callable[[Any, Any], Any]:  # fmt: skip
    """The cost of points (n, d) of the cube, given `Search._data`; one identity for a choice, so that it is compiled
    once."""

    def over(value, limit):
        return STEEPNESS * jnp.maximum(value / limit - 1.0, 0.0)

    def more_than_asked(scores, loop, limits):
        """Factors (controllers, plants) for limits that are seldom asked for."""
        found: Any = 1.0
        for name in ("settling", "travel"):
            if name in limited:
                value = getattr(scores, name)
                found = found * (1.0 + over(jnp.where(jnp.isposinf(value), 10.0 * limits[name], value), limits[name]))
        if "gain" in limited or "phase" in limited:
            gain, phase = margins_in_search(loop)
            found = found * (1.0 + over(limits["gain"], gain)) if "gain" in limited else found
            found = found * (1.0 + over(limits["phase"], jnp.maximum(phase, 1.0))) if "phase" in limited else found
        return found

    @jax.jit
    def costs(zs, data):
        h, w, limits, sizes = data["h"], data["w"], data["limits"], data["sizes"]
        controllers = jax.vmap(lambda z: build(z, data["form"]))(zs)
        scores = scores_of(program, controllers, data["loop"])

        def response(parameters):
            c = respond(parameters, w, jnp)
            s = 1.0 / (1.0 + open_loop(c, h, jnp))
            ms = jnp.max(jnp.abs(s), axis=-1)
            if c.ndim > 1:
                ms = jnp.maximum(ms, jnp.max(jnp.abs(1.0 / (1.0 + outer_loop(c, h))), axis=-1))
            return s, ms, noise_at_input(c, s, data["weights"], data["noise"], jnp)

        s, ms, moved = jax.vmap(response)(controllers)
        parts = [figure(name, scores, moved, data["half"]) / sizes[name] for name in figures]

        def punished(cost):
            cost = cost * (
                1.0
                + over(scores.overshoot, limits["overshoot"])
                + over(ms, limits["ms"])
                + over(moved, limits["moved"])
            )
            cost = cost * (1.0 + over(scores.outside, limits["outside"]))
            cost = cost * (1.0 + STEEPNESS * jnp.maximum(scores.left - limits["left"], 0.0))
            cost = cost * more_than_asked(scores, 1.0 / s - 1.0, limits) if limited else cost
            return demand.over_plants(jnp.where(jnp.isfinite(cost), cost, 1e6))

        if not front:
            return punished(sum(data["shares"][i] * part for i, part in enumerate(parts)))
        ideal, spread, shares = data["goal"]
        counted = jnp.stack([shares[i] * (punished(part) - ideal[i]) / spread[i] for i, part in enumerate(parts)])
        return jnp.max(counted, axis=0) + AUGMENTED * jnp.sum(counted, axis=0)

    return costs
