"""The BBOB functions (Hansen, Finck, Ros and Auger 2009, INRIA RR-6829) and runs on them that are counted.

Costs come from COCO itself (cocoex), without it from ioh; the optimal values come from ioh, which tells them. Both
compute the same instances: they agree to 1e-11 on all functions but f19, where it is 3e-9 of the cost.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

FUNCTIONS = tuple(range(1, 25))
INSTANCES = tuple(range(1, 16))
DIMENSIONS = (5, 20)
LOWER, UPPER = -5.0, 5.0
TARGETS = 10.0 ** (np.arange(20, -82, -2) / 10)  # 10^2, 10^1.8, ..., 10^-8 above the optimum: 51


class Done(Exception):
    """The budget is spent or the last target reached; ends an optimizer from inside."""


@dataclass(frozen=True)
class Problem:
    """One instance: `cost` maps a point (d,) of the box [-5, 5]^d to a float, `optimum` is its least value."""

    function: int
    dimension: int
    instance: int
    optimum: float
    cost: Callable[[Any], float]


@lru_cache(maxsize=2)
def coco_suite(dimension: int) -> Any:
    """The suite of COCO for one dimension. Raises ImportError without cocoex."""
    import cocoex

    return cocoex.Suite("bbob", f"instances: 1-{INSTANCES[-1]}", f"dimensions: {dimension}")


def problem(function: int, dimension: int, instance: int) -> Problem:
    """An instance of a function. Raises SystemExit with what to install."""
    try:
        import ioh as ioh_module
    except ImportError:
        sys.exit("The optimal values of the BBOB functions come from the package 'ioh'; install it.")
    ioh: Any = ioh_module
    told = ioh.get_problem(function, instance=instance, dimension=dimension, problem_class=ioh.ProblemClass.BBOB)
    optimum = float(told.optimum.y)
    try:
        found = coco_suite(dimension).get_problem_by_function_dimension_instance(function, dimension, instance)
    except ImportError:
        found = told
    return Problem(function, dimension, instance, optimum, found)


@dataclass
class Run:
    """An optimizer's evaluations on one problem: counted, cut at the budget, their improvements kept.

    `at` and `above` are the evaluation and the distance to the optimum of every improvement. A call after the last
    evaluation raises Done. `points` keeps everything evaluated when `keep` is set.
    """

    problem: Problem
    budget: int
    keep: bool = False
    evaluations: int = 0
    best: float = np.inf
    at: list[int] = field(default_factory=list)
    above: list[float] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)

    @property
    def dimension(self) -> int:
        return self.problem.dimension

    @property
    def remaining(self) -> int:
        return self.budget - self.evaluations

    @property
    def done(self) -> bool:
        return self.evaluations >= self.budget or self.best <= TARGETS[-1]

    def __call__(self, x: Any) -> float:
        """Cost of a point (d,)."""
        return float(self.costs(np.asarray(x, dtype=float)[None])[0])

    def costs(self, x: Any) -> np.ndarray:
        """Costs (n,) of points (n, d). Raises Done when the budget does not cover them, after evaluating what it
        covers."""
        x = np.ascontiguousarray(x, dtype=float)
        if self.done:
            raise Done
        here = x[: self.remaining]
        cost = self.problem.cost
        f = np.array([cost(row) for row in here])
        if self.keep:
            self.points.append(here.copy())
        self._record(f - self.problem.optimum)
        if len(here) < len(x):
            raise Done
        return f

    def _record(self, above: np.ndarray) -> None:
        above = np.where(np.isnan(above), np.inf, above)
        lowest = np.minimum.accumulate(np.concatenate([[self.best], above]))
        for k in np.flatnonzero(lowest[1:] < lowest[:-1]):
            self.at.append(self.evaluations + int(k) + 1)
            self.above.append(float(above[k]))
        self.best = float(lowest[-1])
        self.evaluations += len(above)


def seed_of(seed: int, function: int, dimension: int, instance: int) -> int:
    """A seed below 2^31 of its own for every run."""
    return int(np.random.SeedSequence([seed, function, dimension, instance]).generate_state(1)[0] >> 1)
