"""The dynamic task: 310 parameters searched by the paper's five methods, and with exact derivatives."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.shared.stages import within
from plantfit.cases.steam.adaptive_bdf import Descent, Descents, Step
from plantfit.cases.steam.problems import dynamic_problem
from plantfit.errors import Status
from plantfit.optimize import minimise
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.study.objective import objective_of

STATIC, BOX, RANDOM = "static solution", "whole box", "random points"
POLISHED, CHECKED = 8, 16  # steps a sample of a last descent, and of the costs that are reported
FINITE = "L-BFGS-B, finite differences"
PAPERS = ("CMA-ES", FINITE, "DISH", "HMS", "SHADE")  # labels of the methods in the paper's table 2, in its order


@dataclass(frozen=True)
class Method:
    """A method of the registry under the name that the page shows, where it starts, and its settings; `drawless`: one
    run tells all.

    With `polish` a tenth of the budget is kept for a last descent at `POLISHED` steps a sample.
    """

    label: str
    name: str
    start: str
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    drawless: bool = False
    polish: bool = False


METHODS = (
    Method("CMA-ES", "cmaes", STATIC),
    Method("DISH", "dish", BOX),
    Method("HMS", "hms", BOX),
    Method("SHADE", "shade", BOX),
    Method("sep-CMA-ES", "sep_cmaes", STATIC),
    Method("DD-CMA-ES", "dd_cmaes", STATIC),
    Method("L-BFGS-B, exact", "lbfgsb", STATIC, {"max_steps": 10_000}, drawless=True),
    Method("least squares, exact", "least_squares", STATIC, {"agree": 1}, drawless=True, polish=True),
    Method("L-BFGS-B, exact, random starts", "lbfgsb", RANDOM, {"max_steps": 10_000}),
    Method("least squares, exact, random starts", "least_squares", RANDOM, polish=True),
)
"""With `agree` 1 a run of least squares is one descent; else each opening begins anew, until its best end was found
five times or the budget is spent. `max_steps`: L-BFGS-B ends with the budget."""


@dataclass(frozen=True)
class MethodRuns:
    """Runs of one method from `start`; costs are those of equation (7), bar^2."""

    label: str
    start: str
    runs: tuple[RunResult, ...]

    @property
    def costs(self) -> np.ndarray:
        """Final costs (n,)."""
        return np.array([r.cost for r in self.runs])

    @property
    def best(self) -> RunResult:
        return min(self.runs, key=lambda r: r.cost)


def method_runs(
    problem: Problem,
    method: Method,
    static: np.ndarray,
    runs: int,
    budget: int,
    seed: int,
    progress: Callable[[Any], None] | None = None,
) -> MethodRuns:
    """Runs of a method on a `weighted` dynamic problem; `static` (d,) is where the local ones begin.

    Final costs are those at `CHECKED` steps a sample: a search that fits 310 numbers to the noise fits them to errors
    of its steps too.
    """
    objective = objective_of(problem)
    if method.start == STATIC:
        objective = dataclasses.replace(objective, start=static[None])
    count = 1 if method.drawless else runs
    kept = budget // 10 if method.polish else 0
    settings = dict(method.settings)
    found = minimise(
        objective, method.name, runs=count, budget=budget - kept, seed=seed, settings=settings, progress=progress
    )
    if kept:
        found = [_polished(problem, r, kept) for r in found]
    ends = np.resize([r.x for r in found], (runs, problem.space.dimension))  # as many for every method: compiled once
    checked = np.asarray(finely(problem).costs(ends))[: len(found)]
    return MethodRuns(
        method.label,
        method.start,
        tuple(dataclasses.replace(r, cost=float(c)) for r, c in zip(found, checked, strict=True)),
    )


def finely(problem: Problem, steps: int = CHECKED) -> Problem:
    """The problem with so many times the steps a sample."""
    return problem.with_simulator(problem.predictor.stepping().refined(steps))


def _polished(problem: Problem, run: RunResult, budget: int) -> RunResult:
    """A run led on by exact least squares at `POLISHED` steps a sample."""
    fine = finely(problem, POLISHED)
    [last] = minimise(
        objective_of(fine, run.x[None]), "least_squares", budget=budget, seed=run.seed, settings={"agree": 1}
    )
    return dataclasses.replace(
        run,
        x=last.x,
        evaluations=run.evaluations + last.evaluations,
        seconds=run.seconds + last.seconds,
        history_evaluations=np.append(run.history_evaluations, run.evaluations + last.evaluations),
        history_cost=np.append(run.history_cost, last.cost),
    )


def opening_runs(
    recordings: Mapping[str, Recording],
    method: Method,
    static: Mapping[str, np.ndarray],
    runs: int,
    budget: int,
    seed: int,
    problems: Mapping[str, Problem] | None = None,
    progress: Callable[[Any], None] | None = None,
) -> MethodRuns:
    """The same opening by opening: ten searches of 31 parameters with `budget` each, their costs summed over runs of
    the same seed.

    `x` of the summed runs holds the openings one after the other, 31 coordinates each.
    """
    problems = problems or opening_problems(recordings)
    told = {n: within(f"{method.label}, {n} alone", progress) for n in recordings}
    each = [method_runs(problems[n], method, static[n], runs, budget, seed, told[n]).runs for n in recordings]
    return MethodRuns(method.label, method.start, tuple(summed(same) for same in zip(*each, strict=True)))


def opening_problems(recordings: Mapping[str, Recording]) -> dict[str, Problem]:
    """A problem of 31 parameters for each opening."""
    return {n: dynamic_problem({n: r}, weighted=True) for n, r in recordings.items()}


def summed(runs: Sequence[RunResult]) -> RunResult:
    """Runs on separate openings as one: costs, evaluations and seconds added, histories where all had spent the same
    share."""
    shares = np.linspace(0.0, 1.0, 201)[1:]
    costs = np.zeros(len(shares))
    for r in runs:
        place = np.searchsorted(r.history_evaluations, shares * max(r.evaluations, 1.0) * (1 + 1e-12), side="right") - 1
        costs += np.where(place < 0, np.inf, r.history_cost[np.maximum(place, 0)])
    spent = float(sum(r.evaluations for r in runs))
    return dataclasses.replace(
        runs[0],
        x=np.concatenate([r.x for r in runs]),
        cost=float(sum(r.cost for r in runs)),
        evaluations=spent,
        seconds=sum(r.seconds for r in runs),
        failures=sum(r.failures for r in runs),
        history_evaluations=shares * spent,
        history_cost=costs,
        extra={},
    )


def until(run: RunResult | Descent, evaluations: float) -> float:
    """Best cost of a run when it had spent so many evaluations."""
    before = run.history_evaluations <= evaluations
    return float(np.min(run.history_cost[before])) if np.any(before) else np.inf


# -- finite differences through BDF --------------------------------------------------------------------


def steps_of(recordings: Mapping[str, Recording]) -> list[Step]:
    """Every record as the BDF simulation takes it."""
    return [Step(float(r["u"][-1]), np.asarray(r.t[1:]), np.asarray(r["y"][1:])) for r in recordings.values()]


def order_of(problem: Problem) -> np.ndarray:
    """Coordinates (d,) of a dynamic problem in the order k[10], A1[10], A2[10], Td of each opening, one opening
    after the other."""
    return np.concatenate([problem.space.local(name) for name in problem.experiments])


def as_run(found: Descent, seed: int, seconds: float = 0.0) -> RunResult:
    """A descent as a run of the study; its coordinates stay in the descent's order."""
    status = Status.budget if found.why == "budget spent" else Status.converged
    return RunResult(
        "lbfgsb", 0, seed, found.x, found.cost, float(found.evaluations), seconds, status, found.history_evaluations,
        found.history_cost,
        extra={"why": found.why},
    )  # fmt: skip


def finite_runs(problem: Problem, found: Descents, seed: int) -> tuple[MethodRuns, MethodRuns | None]:
    """L-BFGS-B with finite differences on all openings at once, in the coordinates of `problem`, and on each alone,
    summed."""
    whole = as_run(found.together, seed, found.seconds)
    x = np.zeros(problem.space.dimension)
    x[order_of(problem)] = found.together.x
    together = MethodRuns(FINITE, STATIC, (dataclasses.replace(whole, x=x),))
    if not found.alone:
        return together, None
    return together, MethodRuns(FINITE, STATIC, (summed([as_run(d, seed) for d in found.alone]),))
