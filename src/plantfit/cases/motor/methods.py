"""The paper's objective searched by its binary genetic algorithm and by other methods, every run with the same
budget."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.motor.bench import TRUTH
from plantfit.cases.shared.stages import stages
from plantfit.findings.results.methods_compared import ProblemComparison
from plantfit.optimize import RunResult, minimise
from plantfit.problem import Problem
from plantfit.problem.measure.experiment import Experiment
from plantfit.spec import load
from plantfit.spec.study import Study
from plantfit.stages import prepare
from plantfit.study.comparing.problem_runs import ProblemRuns
from plantfit.study.comparing.record import compared
from plantfit.study.objective import objective_of
from plantfit.study.store.records import RunRecord

# what is compared: the label, the method and what is set of it beside the study file
GA = {"GA, 0.4 by fractions": {"rates": "fractions"}, "GA, 0.4 by individual": {"rates": "individual"}}
SMALL = ("auto", "least_squares", "pso")
FULL = ("auto", "least_squares", "cmaes", "lshade", "de", "pso", "cga", "salp_swarm", "sobol")
SLOPED = ("auto", "least_squares")  # by derivatives
RK4_STEPS, GUARDED = 10, 30 * 69  # substeps of 10 ms, a fixed step like that of a block diagram; evaluations


@dataclass(frozen=True)
class Methods:
    """`results` by label, `record` of their comparison (`plantfit.study.comparing.record`), `truth` the cost at the
    bench's constants."""

    problem: Problem
    results: Mapping[str, list[RunResult]]
    record: ProblemComparison
    truth: float
    budget: int

    def answers(self, label: str) -> np.ndarray:
        """Constants (runs, d) where each run of a method ended."""
        return np.asarray(self.problem.space.physical(np.array([r.x for r in self.results[label]])))

    def best(self, label: str) -> dict[str, float]:
        """Constants of the best run, and Kt, which is Kb."""
        values = self.answers(label)[int(np.argmin([r.cost for r in self.results[label]]))]
        found = dict(zip(self.problem.space.names, values.tolist(), strict=True))
        return {"Kt": found["Kb"]} | found


def labels(full: bool) -> tuple[str, ...]:
    """What is compared, in the page's order."""
    return (*GA, *(FULL if full else SMALL))


def searches(
    study: Study, chosen: Sequence[str], runs: int, begins: Callable[[str], None] | None = None
) -> dict[str, list[RunResult]]:
    """`runs` of the `chosen` labels on a two_errors.toml study."""
    objective, plan = prepare(study.problem).objective, study.plan
    results = {}
    for label in chosen:
        if begins is not None:
            begins(label)
        method = "binary_ga" if label in GA else label
        settings = dict(plan.settings.get(method, {})) | GA.get(label, {})
        results[label] = minimise(objective, method, runs=runs, budget=plan.budget, seed=plan.seed, settings=settings)
    return results


def sloped(file: Path, runs: int, progress: Callable[[Any], None] | None = None) -> list[list[RunResult]]:
    """The searches by derivatives, for a process of its own beside the others; runs in the order of `SLOPED`."""
    return list(searches(load(file), SLOPED, runs, stages(SLOPED, progress)).values())


def methods_of(study: Study, results: Mapping[str, list[RunResult]]) -> Methods:
    """The comparison of what the searches of a study found."""
    problem, plan = prepare(study.problem).problem, study.plan
    runs_of = tuple(_as_record(label, r, problem) for label, own in results.items() for r in own)
    budgets = dict.fromkeys(results, float(plan.budget))
    record = compared([ProblemRuns(study.name, runs_of, problem.space.names, budgets)], seed=plan.seed).problems[0]
    return Methods(problem, results, record, cost_at(problem, TRUTH), plan.budget)


def cost_at(problem: Problem, constants: Mapping[str, float]) -> float:
    """J at constants by name."""
    return float(problem.cost(np.asarray(problem.space.cube(np.array([constants[n] for n in problem.space.names])))))


def errors_at(problem: Problem, constants: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,) in s, e1 (rad/s) and e2 (V) there, at constants by name."""
    [experiment] = problem.experiments.values()
    error = _errors(problem, constants)
    return experiment.recording.t, -error["w"], -error["Ve"]


def parts_at(problem: Problem, constants: Mapping[str, float]) -> tuple[float, float]:
    """Root mean squares of e1 (rad/s) and e2 (V) at constants by name."""
    error = _errors(problem, constants)
    return tuple(float(np.sqrt(np.mean(error[o] ** 2))) for o in ("w", "Ve"))  # pyrefly: ignore[bad-return]


def _errors(problem: Problem, constants: Mapping[str, float]) -> dict[str, np.ndarray]:
    [experiment] = problem.experiments.values()
    made = problem.predict(np.array([constants[n] for n in problem.space.names]))
    return {o: made[o] - experiment.recording[o] for o in problem.outputs}


def guarded(study: Study) -> RunResult:
    """A short run of the genetic algorithm where the simulation is a fixed-step RK4, which overflows for short time
    constants."""
    plain = study.problem
    experiments: dict[str, Experiment] = dict(plain.experiments)
    problem = Problem(
        plain.model,
        experiments,
        plain.space.parameters,
        scales=plain.scales,
        stepper="rk4",
        substeps=RK4_STEPS,
        name="rk4",
    )
    settings = dict(study.plan.settings["binary_ga"])
    return minimise(objective_of(problem), "binary_ga", budget=GUARDED, seed=study.plan.seed, settings=settings)[0]


def _as_record(label: str, r: RunResult, problem: Problem) -> RunRecord:
    values = dict(zip(problem.space.names, np.asarray(problem.space.physical(r.x)).tolist(), strict=True))
    told = replace(r, method=label)
    return RunRecord(label, told.run, told.seed, told.x, told.cost, values, told.evaluations, told.seconds, told.status,
                     told.failures,
                     told.history_evaluations, told.history_cost, told.extra)  # fmt: skip
