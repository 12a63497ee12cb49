"""One search of one problem at the default budget, and whether what it says of itself is true.

A search says that so many independent local searches ended at its answer, and that it has converged. The judge keeps
every point at which it saw a Jacobian, runs scipy's local search on from the answer and from every counted end that it
can find again, and looks whether they stay where they were said to be.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit as pf
from benchmarks.search_suite.descents import descend
from benchmarks.search_suite.truths import SAME, Truth
from plantfit.optimize import minimise
from plantfit.optimize.contract import Objective, Projected
from plantfit.optimize.local.damped_steps import Rows
from plantfit.study.objective import objective_of
from plantfit.study.plan import default_budget

AGREE = 3  # hits from which a search may call itself converged, the default of auto


@dataclass(frozen=True)
class Verdict:
    """What one run found and said.

    `found`: its cost is the certified best. `false_convergence`: it said converged, by its own count of agreeing
    searches, at another cost. `unfinished`: a local search from its answer goes on downhill. Of the ends listed at its
    cost, which hold the `counted` ones, `rerun` had points that were seen, and `stray` of these, run to their end, did
    not end at the answer. `miscounted`: it claims more agreeing searches than it lists, lists a lower cost than it
    returns, or says converged with too few that agree. `solved_for`: coordinates that it solved for at every point and
    did not search.
    """

    problem: str
    seed: int
    cost: float
    excess: float
    found: bool
    status: str
    hits: int | None
    starts: int | None
    evaluations: float
    seconds: float
    false_convergence: bool
    unfinished: bool
    miscounted: bool
    counted: int
    rerun: int
    stray: int
    solved_for: int


class Watch:
    """Full cube points (d,) at which derivatives were seen, with their costs."""

    def __init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._costs: list[np.ndarray] = []
        self._taken: set[int] = set()

    def objective(self, objective: Objective) -> Objective:
        """The same, watched, whichever of its evaluators a search asks for derivatives."""
        changed: dict[str, Any] = {}
        for name in ("batch_rows", "residuals_and_jacobian", "compressed"):
            function = getattr(objective, name)
            if function is not None:
                changed[name] = self._around(function)
        inner = objective.projected
        if inner is not None:

            def watched() -> Projected | None:
                projected = inner()
                return None if projected is None else WatchedProjection(projected, self)

            changed["projected"] = watched
        return dataclasses.replace(objective, **changed)

    def see(self, points: np.ndarray, residuals: np.ndarray) -> None:
        """Points (n, d) and rows (n, k) whose mean square is the cost."""
        self._points.append(np.array(points))
        self._costs.append(Rows(residuals, residuals, points).squares / residuals.shape[1])

    def _around(self, function: Callable) -> Callable:
        def watched(z: Any) -> Any:
            found = function(z)
            points = np.atleast_2d(np.asarray(z, dtype=float))
            self.see(points, np.asarray(found[0], dtype=float).reshape(len(points), -1))
            return found

        return watched

    def at(self, cost: float) -> np.ndarray | None:
        """The point with this cost up to rounding that lies nearest in cost and was not given before; None when
        there was none."""
        if not self._costs:
            return None
        costs = np.concatenate(self._costs)
        away = np.abs(costs - cost)
        away[list(self._taken)] = np.inf
        k = int(np.nanargmin(np.where(np.isfinite(away), away, np.inf)))
        if not away[k] <= 1e-12 * abs(cost) + 1e-300:
            return None
        self._taken.add(k)
        return np.concatenate(self._points)[k]


@dataclass(frozen=True)
class WatchedProjection:
    """A projected problem whose full points are seen."""

    inner: Projected
    watch: Watch

    @property
    def kept(self) -> np.ndarray:
        return self.inner.kept

    @property
    def charge(self) -> float:
        return self.inner.charge

    @property
    def cost_charge(self) -> float:
        return self.inner.cost_charge

    def rows(
        self, zn: np.ndarray, below: np.ndarray | None = None, /
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        r, jacobian, points, whole = (np.asarray(a) for a in self.inner.rows(zn, below))
        self.watch.see(points, r)
        return r, jacobian, points, whole

    def sample(self, zn: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        return self.inner.sample(zn)


def judge(
    problem: pf.Problem,
    truth: Truth,
    seed: int,
    *,
    method: str = "auto",
    settings: dict[str, Any] | None = None,
    budget: int | None = None,
) -> Verdict:
    """Search with `seed` at the default budget and hold what is said against the truth."""
    watch, settings = Watch(), settings or {}
    [result] = minimise(
        watch.objective(objective_of(problem)), method, runs=1,
        budget=budget or default_budget(problem.space.dimension), seed=seed,
        settings=settings,
    )  # fmt: skip
    same = result.cost * (1 + SAME) + truth.floor
    listed = [float(c) for c in result.extra.get("local_costs", [])]
    hits, starts = result.extra.get("basin_hits"), result.extra.get("starts")
    agreeing = [c for c in listed if c <= same]
    points = [p for p in map(watch.at, agreeing) if p is not None]
    ends = [descend(problem, p).cost for p in points]
    further = descend(problem, result.x).cost
    status = str(result.status)
    return Verdict(
        problem.name,
        seed,
        result.cost,
        result.cost / truth.cost - 1 if truth.cost > 0 else float(result.cost),
        truth.reached(result.cost),
        status,
        hits,
        starts,
        result.evaluations,
        round(result.seconds, 2),
        status == "converged" and (hits is None or hits >= AGREE) and not truth.reached(result.cost),
        further < result.cost * (1 - SAME) - truth.floor,
        (hits or 0) > len(agreeing)
        or any(c < result.cost * (1 - SAME) - truth.floor for c in listed)
        or (status == "converged" and hits is not None and hits < settings.get("agree", AGREE)),
        hits or 0,
        len(points),
        sum(not (abs(e - result.cost) <= SAME * result.cost + truth.floor) for e in ends),
        result.extra.get("solved_for", 0),
    )
