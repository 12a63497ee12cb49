"""Tune the settings of one method on a problem with another method outside.

from plantfit.study.tuning.tuner import tune

found = tune(objective, "pso", outer="pso", budget=5000, runs=20, trials=60, seed=1)
print(found.sentence)
print(found.toml())
"""

import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import Interrupted, SearchError
from plantfit.optimize.contract import Facts, Objective
from plantfit.optimize.loop.counter import BudgetSpent, Counter
from plantfit.optimize.loop.entry import check_needs, minimise
from plantfit.optimize.loop.many_settings import Job, Sweep
from plantfit.optimize.loop.nested import Nested
from plantfit.optimize.loop.progress import Progress
from plantfit.optimize.registry import make
from plantfit.study.tuning.dials import Dials, dials_of
from plantfit.study.tuning.outcome import Contest, Finish, Trial, Tuned, contest, finish
from plantfit.study.tuning.racing import race

import jax
import jax.numpy as jnp

FRESH = 20  # fewest fresh seeds in the final comparison
GENERATIONS = 6  # an outer population leaves the trials at least so many generations
SMALLEST_OUTER = 5
OUTER_KEY = 2**32 - 1  # no run has this number

Key = tuple[Any, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TuningProgress(Progress):
    """Where tuning stands; a run is one trial of settings here."""

    method: str
    unit: str = "setting"


def tune(
    objective: Objective,
    method: str,
    outer: str = "pso",
    *,
    only: Iterable[str] | None = None,
    ranges: Mapping[str, Sequence[Any]] | None = None,
    held: Mapping[str, Any] | None = None,
    budget: int = 5000,
    runs: int = 20,
    trials: int = 60,
    seed: int = 1,
    outer_settings: Mapping[str, Any] | None = None,
    progress: Callable[[TuningProgress], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Tuned:
    """Search the settings of a registered method with another one outside.

    The outer method walks a unit cube of settings (`only`, `ranges` and `held` as in `dials_of`) and asks for `trials`
    settings, the default among them. Each is raced against the best so far over runs 0 to `runs` - 1 of the seed,
    with `budget` evaluations a run. The cost of settings is the median over their runs of the final cost; costs
    equal to a millionth are ranked by the evaluations until they were reached. Settings that leave a race early
    report the median so far, but never less than the best has. At the end the best and the default settings meet
    on max(runs, 20) fresh runs, numbered from `runs`. The same arguments give the same bits. When `stop` turns
    true, what was found so far comes back, marked as interrupted. Raises SearchError.
    """
    for what, value, low in (("budget", budget, 1), ("runs", runs, 2), ("trials", trials, 2), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value < 2**30:
            raise SearchError(f"{what} is {value!r}; give a whole number of at least {low} and below {2**30}.")
    check_needs(method, make(method, **dict(held or {})), objective)
    dials = dials_of(
        method,
        Facts(objective.dimension, budget, objective.lower, objective.upper, objective.start),
        only,
        ranges,
        held,
    )
    tuner = _Tuner(objective, dials, outer, budget, runs, trials, seed, progress, stop)
    return tuner.run(dict(outer_settings or {}))


class _Counter(Counter):
    """The Counter of the outer method: its costs are races, not a compiled function."""

    def __init__(
        self,
        objective: Objective,
        budget: int,
        race: Callable[[np.ndarray], np.ndarray],
        stop: Callable[[], bool] | None,
    ):
        super().__init__(objective, budget, stop=stop)
        self._race = race

    def _chunk(self, x: np.ndarray, size: int) -> np.ndarray:
        return self._race(x)


class _Tuner:
    """State of one tuning: every run that was made, the races, and the best so far."""

    def __init__(
        self, objective: Objective, dials: Dials, outer: str, budget: int, runs: int, trials: int, seed: int,
        progress: Callable[[TuningProgress], None] | None, stop: Callable[[], bool] | None,
    ):  # fmt: skip
        self.objective, self.dials, self.outer = objective, dials, outer
        self.budget, self.runs, self.trials, self.seed = budget, runs, trials, seed
        self.fresh = max(runs, FRESH)
        self.progress, self.stop = progress, stop
        self.finishes: dict[Key, list[Finish]] = {}
        self.scores: dict[Key, list[float]] = {}
        self.dropped: set[Key] = set()
        self.best: Key | None = None
        self.sweeps: dict[Any, Sweep] = {}
        first = {n: words[0] for n, words in dials.options}
        self.template = {n: dials.defaults[n] for n in dials.traced} | first  # values that no compiled loop holds
        self.asked, self.evaluations, self.began = 0, 0.0, time.perf_counter()

    def run(self, outer_settings: dict[str, Any]) -> Tuned:
        default = self._key(self.dials.defaults)
        found: Contest | None = None
        interrupted = False
        drive = self._outer(outer_settings)
        try:
            self._race([default])
            drive()
            if self.best is not None and self.best != default:
                found = self._contest(self._settings(self.best), self.dials.defaults)
            self._report(done=True)
        except Interrupted:
            interrupted = True
        return Tuned(
            method=self.dials.method, outer=self.outer,
            best=self._settings(default if self.best is None else self.best),
            default=self.dials.defaults, dials=[d.record() for d in self.dials.dials], trials=self._trials(),
            contest=found,
            interrupted=interrupted, budget=self.budget, seed=self.seed, search_runs=(0, self.runs - 1),
            fresh_runs=(self.runs, self.runs + self.fresh - 1), evaluations=self.evaluations,
            seconds=time.perf_counter() - self.began,
        )  # fmt: skip

    # the outer method

    def _outer(self, settings: dict[str, Any]) -> Callable[[], None]:
        """The outer search, checked and ready to begin."""
        dimension = len(self.dials.dials)
        start = self.dials.places(self.dials.defaults)[None, :]
        cube = Objective(dimension, _no_costs, start=start, lower=np.zeros(dimension), upper=np.ones(dimension))
        facts = Facts(dimension, self.trials, cube.lower, cube.upper, start)
        method: Any = self._outer_method(settings, facts)
        check_needs(self.outer, method, cube)
        if hasattr(method, "choose"):
            method, _ = method.choose(cube, self.trials)
        counter = _Counter(cube, self.trials, self._costs, self.stop)
        key = jax.random.fold_in(jax.random.key(self.seed), jnp.uint32(OUTER_KEY))

        def drive() -> None:
            try:
                if hasattr(method, "run"):
                    method.run(key, cube, self.trials, counter)
                    return
                population = Nested(method, facts, key)
                while not population.stopped:
                    population.generation(counter)
            except BudgetSpent:
                return

        return drive

    def _outer_method(self, settings: dict[str, Any], facts: Facts) -> Any:
        """The outer method with a population that the trials can feed, unless the user set one."""
        method: Any = make(self.outer, **settings)
        if not hasattr(method, "rows"):
            return method
        names = {f.name for f in dataclasses.fields(method)}
        few = max(method.needs.minimum_population, SMALLEST_OUTER, self.trials // GENERATIONS)
        if "population" in names and "population" not in settings and method.rows(facts) > few:
            method = make(self.outer, **settings, population=few)
        if method.rows(facts) > self.trials:
            raise SearchError(
                f"The outer method {self.outer!r} asks for {method.rows(facts)} settings at a time; "
                f"give at least so many trials, not {self.trials}, or another outer method."
            )
        return method

    def _costs(self, x: np.ndarray) -> np.ndarray:
        """Costs (n,) of settings at cube points (n, d): one race."""
        keys = [self._key(self.dials.settings(z)) for z in x]
        self._race(keys)
        self.asked += len(keys)
        self._report()
        return np.array([self._cost(k) for k in keys])

    def _race(self, keys: list[Key]) -> None:
        new = [k for k in dict.fromkeys(keys) if k not in self.scores]
        for k in new:
            self.finishes[k], self.scores[k] = [], []
        gone = race(new, self.scores, self.best, self._measure, self.runs)
        self.dropped |= gone
        for k in new:
            if k not in gone and (self.best is None or np.median(self.scores[k]) < np.median(self.scores[self.best])):
                self.best = k

    def _cost(self, key: Key) -> float:
        own = float(np.median(self.scores[key]))
        if key not in self.dropped or self.best is None:
            return own
        return max(own, float(np.nextafter(np.median(self.scores[self.best]), np.inf)))

    # the inner method

    def _measure(self, keys: list[Key], upto: int) -> None:
        """Bring every settings to runs 0 .. upto - 1."""
        jobs = {k: range(len(self.scores[k]), upto) for k in keys}
        for key, found in self._finishes(jobs).items():
            self.finishes[key] += found
            self.scores[key] += [f.score(self.budget) for f in found]

    def _finishes(self, jobs: Mapping[Key, range]) -> dict[Key, list[Finish]]:
        """The runs of each settings; those that differ in traced values alone share a compiled loop."""
        found: dict[Key, list[Finish]] = {}
        together: dict[Any, list[tuple[Key, Any]]] = {}
        for key, numbers in jobs.items():
            try:
                method: Any = make(self.dials.method, **self._settings(key))
                if hasattr(method, "choose") or hasattr(method, "run"):
                    found[key] = self._alone(self._settings(key), numbers)
                    continue
                template = dataclasses.replace(method, **self.template)
                self._sweep(template)
                together.setdefault(template, []).append((key, method))
            except SearchError:  # settings that contradict one another
                if key == self._key(self.dials.defaults):
                    raise
                found[key] = [Finish(np.inf, np.inf)] * len(numbers)
        for template, members in together.items():
            sweep = self._sweep(template)
            order = [(key, Job(sweep.values(method), run)) for key, method in members for run in jobs[key]]
            outcomes = sweep.run([job for _, job in order], stop=self.stop, progress=self._spent)
            for (key, _), outcome in zip(order, outcomes, strict=True):
                found.setdefault(key, []).append(
                    finish(outcome.cost, outcome.history_evaluations, outcome.history_cost)
                )
        return found

    def _sweep(self, template: Any) -> Sweep:
        if template not in self.sweeps:
            self.sweeps[template] = Sweep(
                self.objective, template, self.dials.traced, self.dials.options, self.budget, self.seed
            )
        return self.sweeps[template]

    def _alone(self, settings: dict[str, Any], numbers: range) -> list[Finish]:
        """Runs as any study makes them."""
        self._check_stop()
        results = minimise(
            self.objective, self.dials.method, runs=len(numbers), first_run=numbers[0], budget=self.budget,
            seed=self.seed,
            settings=settings, stop=self.stop,
        )  # fmt: skip
        self._check_stop()
        self._spent(sum(r.evaluations for r in results))
        return [finish(r.cost, r.history_evaluations, r.history_cost) for r in results]

    def _contest(self, tuned: dict[str, Any], default: dict[str, Any]) -> Contest:
        fresh = range(self.runs, self.runs + self.fresh)
        return contest(self._alone(tuned, fresh), self._alone(default, fresh), self.budget, self.seed)

    # bookkeeping

    def _key(self, settings: Mapping[str, Any]) -> Key:
        return tuple(settings[d.name] for d in self.dials.dials)

    def _settings(self, key: Key) -> dict[str, Any]:
        return {**self.dials.held, **{d.name: value for d, value in zip(self.dials.dials, key, strict=True)}}

    def _trials(self) -> list[Trial]:
        """What was tried, the default first; settings that were stopped before their first run are left out."""
        return [
            Trial(self._settings(k), len(f), float(np.median([r.cost for r in f])), k in self.dropped)
            for k, f in self.finishes.items()
            if f
        ]

    def _check_stop(self) -> None:
        if self.stop is not None and self.stop():
            raise Interrupted("The tuning was stopped; the best so far is kept.")

    def _spent(self, evaluations: float) -> None:
        self.evaluations += evaluations
        self._report()

    def _report(self, done: bool = False) -> None:
        if self.progress is None:
            return
        # what is left costs as much for each trial as those before it
        each = self.evaluations / self.asked if self.asked else float(self.runs * self.budget)
        total = self.evaluations if done else max(self.trials * each + 2.0 * self.fresh * self.budget, self.evaluations)
        seconds = time.perf_counter() - self.began
        left = (total - self.evaluations) * seconds / self.evaluations if self.evaluations else None
        best = float("inf") if self.best is None else float(np.median([f.cost for f in self.finishes[self.best]]))
        self.progress(
            TuningProgress(
                runs_done=min(self.asked, self.trials),
                runs=self.trials,
                evaluations=self.evaluations,
                budget_total=total,
                best=best,
                seconds=seconds,
                seconds_left=left,
                method=self.dials.method,
            )
        )


def _no_costs(x: Any) -> Any:
    raise SearchError(
        "The outer method looked at the cost of settings outside its counter; choose another outer method."
    )
