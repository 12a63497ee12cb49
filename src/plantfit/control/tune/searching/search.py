"""One form of controller searched over plants: a fast loop that keeps what is asked for on all of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import STEEPNESS, Demand, stacked_controllers
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.frequency import (
    margins_in_search,
    noise_at_input,
    noise_in_moves,
    open_loop,
    outer_loop,
    poles_outside,
)
from plantfit.control.tune.loop_scores import Judge, Program, scores_of
from plantfit.control.tune.searching.figures import figure
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SearchError, Status
from plantfit.optimize import Objective, RunResult, minimise
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
STEEPER = 100.0  # times the penalty of a limit that a first search has paid for a faster loop
UNSTABLE = 10.0  # times the penalty: an unstable loop counts as one of an Ms of eleven times its limit, or worse
GONE = 1e4  # times the figures of a rule on the best fit: a loop that grows without bound
ROOM = 0.95  # of a limit: what the search keeps, so that plants that it has not seen keep the limit


@dataclass(frozen=True, eq=False)
class Search:
    """Controllers of a form over the plants of `judge`, whose sampled responses are `h` (n, F) at w (F,); `sizes`
    are what figures are counted in, `weights` those that are made small, by name, their shares. `poles` are the
    numbers (n,) of the plants' own poles at 1 and outside the unit circle; without them no loop is taken for unstable.
    """

    judge: Judge
    h: np.ndarray
    w: np.ndarray
    wishes: Wishes
    form: Form
    sizes: Mapping[str, float]
    weights: Mapping[str, float]
    poles: tuple[np.ndarray, np.ndarray] | None = None

    def on_best_fit(self) -> "Search":
        """The same on the first plant alone."""
        first = slice(0, 1)
        poles = None if self.poles is None else (self.poles[0][first], self.poles[1][first])
        return replace(self, judge=self.judge.part(first), h=self.h[:1], poles=poles)

    def found(
        self,
        starts: np.ndarray,
        budget: int,
        seed: int,
        progress: Callable[[Any], None] | None,
        sigma: float | None = None,
    ) -> np.ndarray:
        """The point (d,) of the cube of least cost; `starts` (k, d) are tried too, and `sigma` is the first step of
        the search from the best of them, as a share of the cube. Raises SearchError where none keeps all loops finite.

        A penalty can be the price of a faster loop, and the search ends there. Where too many plants miss what is asked
        for, it therefore begins again with a penalty that no speed pays for, and the point that fewer miss is taken.
        """
        found = self._least(self._costs(False), starts, budget, seed, progress, sigma)
        missed = self.missed(found)
        if missed <= 1.0 - self.wishes.share:
            return found
        again = self._least(self.strict(), np.r_[starts, found[None]], budget, seed, progress, sigma)
        return again if self.missed(again) < missed else found

    def cost(self, points: np.ndarray) -> np.ndarray:
        """What a search makes small, of points (k, d) of the cube: (k,)."""
        return _in_rows(self._costs(False), points)

    def best_of(self, points: np.ndarray) -> np.ndarray:
        """The one (d,) of points (k, d) of the cube that costs least, the first of several that cost the same."""
        return points[np.argmin(self.cost(points))]

    def strict(self) -> CostOfData:
        """The cost with a penalty that no speed pays for."""
        return self._costs(False, steepness=STEEPER * STEEPNESS)

    def missed(self, point: np.ndarray) -> float:
        """The share of the plants that miss what is asked for, at a point (d,) of the cube."""
        return float(_in_rows(self._costs(False, room=1.0, counted=True), point[None])[0])

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
        self,
        costs: CostOfData,
        starts: np.ndarray,
        budget: int,
        seed: int,
        progress: Callable[[Any], None] | None,
        sigma: float | None = None,
    ) -> np.ndarray:
        first = _in_rows(costs, starts)
        best = starts[np.argsort(first)[:1]]
        run = descent(costs, best[0], budget, seed, progress, sigma)
        best_point = np.asarray(run.x if run.cost < np.min(first) else best[0])
        if min(run.cost, np.min(first)) >= 10.0 * GONE:
            raise SearchError(self._why_not_finite(best_point))
        return best_point

    def _why_not_finite(self, point: np.ndarray) -> str:
        """On how many plants the loop with the least bad controller ends at no number, and what to do."""
        controller = self.form.made(jnp.asarray(point))
        scores = self.judge.scores(stacked_controllers([controller]))
        parts = [np.asarray(getattr(scores, name))[0] / self.sizes.get(name, 1.0) for name in ("iae", "load_iae")]
        size = np.nan_to_num(parts[0] + parts[1], nan=np.inf)
        lost = size >= min(GONE, 0.999 * float(np.max(size)))
        count, n = int(np.sum(lost)), len(lost)
        said = f"No {self.form.name} within the bounds of the search keeps the loops of all plants finite"
        if n == 1 or lost[0]:
            which = "the loop of the best fit" if n == 1 else f"{count} of {n} loops, that of the best fit among them,"
            return (
                f"{said}: with the best one {which} ends where the model has no number, or grows without bound. "
                "Keep the loop where the model was measured: a smaller step ([control] step, or --step), limits of the "
                "input nearer to those of the recording (lower and upper), or another set point; or a shorter period."
            )
        return (
            f"{said}: with the best one {count} of {n} loops {'end' if count > 1 else 'ends'} where the model has no "
            f"number, or {'grow' if count > 1 else 'grows'} without bound, and that of the best fit does not. These "
            f"plants are allowed because the data do not know them better{self._apart(lost)}: measure again (`plantfit "
            "design` says how), or give a smaller step ([control] step, or --step)."
        )

    def _apart(self, lost: np.ndarray) -> str:
        """The parameter whose values tell the lost plants from the others best; empty where none does."""
        found = ("", 1.0)
        for name, values in self.judge.plant.plants.items():
            spread = float(np.std(values))
            if np.ndim(values) == 1 and spread > 0:
                away = abs(float(np.mean(values[lost]) - np.mean(values[~lost]))) / spread
                ends = f" ({name} is {np.min(values[lost]):.3g} to {np.max(values[lost]):.3g} there)"
                found = max(found, (ends, away), key=lambda f: f[1])
        return found[0]

    def _costs(
        self,
        front: bool,
        goal: "Goal | None" = None,
        steepness: float = STEEPNESS,
        room: float = ROOM,
        counted: bool = False,
    ) -> CostOfData:
        wishes, program = self.wishes, self.judge.program
        limited = tuple(n for n, given in EXTRA.items() if given(wishes))
        demand = demand_of(wishes)
        form = self.form
        known = self.poles is not None and (form.settled or form.parts is not None)
        function = _costs_of(
            program,
            form.build,
            form.response,
            None if form.settled else form.parts,
            demand,
            tuple(self.weights),
            limited,
            front,
            known,
        )
        return CostOfData(
            function, self._data(goal) | {"limits": self._limits(room), "steepness": steepness, "counted": counted}
        )

    def _limits(self, room: float) -> dict[str, float]:
        """What the search keeps, a share `room` of what is asked for."""
        wishes = self.wishes
        return {
            "overshoot": room * wishes.overshoot, "ms": 1.0 + room * (wishes.ms - 1.0), "moved": wishes.input_noise,
            "outside": room * wishes.tolerated, "left": wishes.settled,
            "settling": room * wishes.settling if EXTRA["settling"](wishes) else 1.0,
            "travel": room * wishes.travel if EXTRA["travel"](wishes) else 1.0,
            "gain": 1.0 + (wishes.gain_margin - 1.0) / room, "phase": wishes.phase_margin / room,
        }  # fmt: skip

    def _data(self, goal: "Goal | None") -> dict[str, Any]:
        """All numbers that costs are made of, but for the limits and what missing them costs."""
        wishes, weights = self.wishes, np.gradient(self.w) / np.pi * self.wishes.period
        shares = np.array(list(self.weights.values()))
        found = {
            "loop": self.judge.data(), "form": self.form.data, "h": self.h, "w": self.w, "weights": weights,
            "sizes": {n: self.sizes[n] for n in self.weights}, "shares": shares,
            "half": 0.5 * self.judge.course.seconds,
            "noise": noises(wishes, self.form.inner), "span": wishes.upper - wishes.lower,
        }  # fmt: skip
        if self.poles is not None:
            at_one = self.form.integrators if self.form.settled else self.form.parted
            found["poles"] = (self.poles[0] + at_one, self.poles[1])
        if goal is not None:
            found["goal"] = (goal.ideal, goal.spread, goal.shares)
        return jax.tree.map(jnp.asarray, found)


@dataclass(frozen=True)
class _Cmaes:
    """`cmaes` driven from outside of the compiled program: a loop over plants takes seconds to compile, and so it is
    compiled once for the search and for points on their own, and the method once for all loops.

    Its generations are as large as what is judged at a time: the usual ones for few parameters are half of that, take
    as long, and end in a corner of the limits far more often.
    """

    needs: ClassVar[Needs] = CmaEs.needs
    sigma: float | None = None

    def run(self, key: Any, objective: Objective, budget: int, counter: Counter) -> Status:
        facts = Facts(objective.dimension, budget, objective.lower, objective.upper, objective.start)
        population = Nested(CmaEs(population=LANES, sigma=self.sigma), facts, key)
        while not population.stopped:
            population.generation(counter)
        return Status.converged


def descent(
    costs: CostOfData,
    start: np.ndarray,
    budget: int,
    seed: int,
    progress: Callable[[Any], None] | None,
    sigma: float | None = None,
) -> RunResult:
    """The search that all of these are: from a point (d,) of the cube, with a first step `sigma`."""
    objective = Objective(len(start), costs, start=start[None])
    runs = minimise(objective, _Cmaes(sigma), budget=budget, runs=1, seed=seed, progress=progress)
    return min(runs, key=lambda r: r.cost)


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
    program: Program, build: Callable[[Any, Any], Any], respond: Callable[..., Any],
    divided: Callable[..., tuple[Any, Any]] | None, demand: Demand,
    figures: tuple[str, ...],
    limited: tuple[str, ...], front: bool, known: bool,
) -> Callable[[Any, Any], Any]:  # fmt: skip
    """The cost of points (n, d) of the cube, given the data of `Search._costs`; one identity for a choice, so that it
    is compiled once. `known`: the poles of all plants and controllers are, and unstable loops are told by them; those
    of controllers that are `divided` are in what is below the line."""

    travels = "travel" in figures or "travel" in limited

    def excess(value, limit):
        return jnp.maximum(value / limit - 1.0, 0.0)

    def more_than_asked(scores, loop, limits, over):
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

        def response(parameters):
            above, below = (respond(parameters, w, jnp), 1.0) if divided is None else divided(parameters, w, jnp)
            c = above / below
            s = 1.0 / (1.0 + open_loop(c, h, jnp))
            ms = jnp.max(jnp.abs(s), axis=-1)
            if c.ndim > 1:
                ms = jnp.maximum(ms, jnp.max(jnp.abs(1.0 / (1.0 + outer_loop(c, h))), axis=-1))
            integrators, unstable = data["poles"] if known else (0, 0)
            outside = poles_outside(below / s - 1.0, integrators, unstable, jnp) if known else jnp.zeros(ms.shape)
            moved = noise_at_input(c, s, data["weights"], data["noise"], jnp)
            if not travels:
                return s, ms, outside, moved, None
            moves = noise_in_moves(c, s, w, program.loop.period, data["weights"], data["noise"], jnp)
            return s, ms, outside, moved, data["span"] * moves

        s, ms, outside, moved, moves = jax.vmap(response)(controllers)
        scores = scores_of(program, controllers, data["loop"], moves)
        parts = [figure(name, scores, moved, data["half"]) / sizes[name] for name in figures]

        def over(value, limit):
            return data["steepness"] * excess(value, limit)

        def punished(cost):
            # Ms falls again beyond the border of stability, where a loop gets the worse the less it is near it
            worst = UNSTABLE * data["steepness"]
            wild = jnp.where(outside == 0, jnp.minimum(over(ms, limits["ms"]), worst), worst * (1.0 + 1.0 / ms))
            missed = over(scores.overshoot, limits["overshoot"]) + wild
            more = 1.0 + over(scores.outside, limits["outside"])
            more = more * (1.0 + data["steepness"] * jnp.maximum(scores.left - limits["left"], 0.0))
            more = more * more_than_asked(scores, 1.0 / s - 1.0, limits, over) if limited else more
            # what noise moves the input by is a target, and no plant misses a limit by it
            misses = (missed > 0.0) | (more > 1.0) | ~jnp.isfinite(cost)
            cost = cost * (1.0 + missed + over(moved, limits["moved"])) * more
            every = demand.over_plants(jnp.where(jnp.isfinite(cost), cost, 1e6))
            return jnp.where(data["counted"], jnp.mean(misses, axis=-1), every)

        if not front:
            return punished(sum(data["shares"][i] * part for i, part in enumerate(parts)))
        ideal, spread, shares = data["goal"]
        counted = jnp.stack([shares[i] * (punished(part) - ideal[i]) / spread[i] for i, part in enumerate(parts)])
        return jnp.max(counted, axis=0) + AUGMENTED * jnp.sum(counted, axis=0)

    return costs
