"""The short way: `fit(problem)` and its `Answer`."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.estimate.estimate import Estimate
from plantfit.optimize import minimise
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.problem.shooting import Shooting
from plantfit.problem.steps import choose_substeps, refined_at
from plantfit.report import summary_text, write_report
from plantfit.study.objective import objective_of
from plantfit.study.plan import default_budget
from plantfit.trust.assess import EDGE, assess
from plantfit.trust.local import linearise
from plantfit.trust.parameter_uncertainty import check_errors
from plantfit.trust.shared_error import SharedError
from plantfit.trust.smoothing_strength import choose_strengths

REWEIGHTED = 3  # rounds of re-estimating the scale of every output


@dataclass(frozen=True)
class Answer:
    """The best parameters, every run, and what they are worth.

    `values` maps coordinate names to numbers in their units; `findings` is the plain record of
    docs/architecture.md, made when first asked for. Shared `errors` widen the intervals there: to first order, or by
    so many `draws` (docs/uncertainty.md).
    """

    problem: Problem
    runs: Sequence[RunResult]
    seed: int
    spec: str | None = None
    command: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    errors: Sequence[SharedError] = ()
    draws: int | None = None

    @property
    def best(self) -> RunResult:
        return min(self.runs, key=lambda r: r.cost)

    @property
    def values(self) -> dict[str, float]:
        physical = np.asarray(self.problem.space.physical(self.best.x))
        return dict(zip(self.problem.space.names, physical.tolist(), strict=True))

    @cached_property
    def findings(self) -> dict[str, Any]:
        started = time.perf_counter()
        record = assess(
            self.problem, self.runs, seed=self.seed, spec=self.spec, command=self.command, seconds=self.seconds,
            errors=self.errors, draws=self.draws,
        )  # fmt: skip
        record["reproduction"]["seconds"]["trust"] = time.perf_counter() - started
        return record

    @property
    def verdict(self) -> str:
        """The verdict as lines of text."""
        return "\n".join(f"{v['level']:>8}: {v['sentence']}" for v in self.findings["verdict"])

    def summary(self) -> str:
        """Verdict and parameters for a terminal."""
        return summary_text(self.findings)

    def report(self, path: str | Path) -> Path:
        """Write the HTML report."""
        return write_report(self.findings, path)

    def predict(self, recording: str | None = None) -> dict[str, np.ndarray]:
        """Every output over a whole recording at the best parameters."""
        return self.problem.predict(np.asarray(self.problem.space.physical(self.best.x)), recording)

    def score(self, part: str = "validation") -> dict[str, float]:
        """RMSE of every output, in its unit, on part "fit" or "validation", over all recordings."""
        rows = [s for s in self.findings["scores"] if s["part"] == part]
        result = {}
        for output in self.problem.outputs:
            own = [s for s in rows if s["output"] == output]
            if own:
                total = sum(s["n"] for s in own)
                result[output] = float(np.sqrt(sum(s["n"] * s["rmse"] ** 2 for s in own) / total))
        return result


def fit(
    problem: Problem,
    method: str = "auto",
    *,
    runs: int = 1,
    budget: int | None = None,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    shooting: int | None = None,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
    spec: str | None = None,
    command: str = "",
    errors: Sequence[SharedError] = (),
    draws: int | None = None,
) -> Answer:
    """Find the parameters and what they are worth.

    Chooses the step of the simulation, searches, estimates the weight of every output from its
    residuals when there are several, checks the step at the answer. With `shooting` every record is
    first cut into so many segments whose ends need not meet, which finds answers in long, oscillating
    and unstable records (docs/long-records.md); the search then begins at what it found. `errors` of
    instruments and `draws` are for the intervals (docs/uncertainty.md). Raises SearchError when no candidate could be simulated.
    """
    check_errors(problem, errors)
    started = time.perf_counter()
    problem = prepare(problem)
    prepared = time.perf_counter()
    start = shooting_starts(problem, shooting, seed)
    if start is not None and method == "auto":
        method, settings = "least_squares", {"agree": 1, **dict(settings or {})}
    results = minimise(
        objective_of(problem, start),
        method,
        runs=runs,
        budget=budget or default_budget(problem.space.dimension),
        seed=seed,
        settings=dict(settings or {}),
        progress=progress,
        stop=stop,
    )
    searched = time.perf_counter()
    problem, results = finish(problem, results, seed)
    seconds = {"prepare": prepared - started, "search": searched - prepared, "finish": time.perf_counter() - searched}
    return Answer(problem, results, seed, spec, command, seconds, tuple(errors), draws)


def shooting_starts(problem: Problem, segments: int | None, seed: int) -> np.ndarray | None:
    """Where multiple shooting with so many segments a record ends (1, d); None without segments."""
    return None if segments is None else Shooting.of(problem, segments=segments).search(seed=seed).z[None, :]


def prepare(problem: Problem) -> Problem:
    """Choose the substeps of the simulation; the same for the same problem, so that a resumed study repeats it."""
    return choose_substeps(problem)


def finish(problem: Problem, results: Sequence[RunResult], seed: int) -> tuple[Problem, list[RunResult]]:
    """Refine the step, the weights and the strengths of smoothing at the best answer, and polish it there; the other runs stay."""
    best = min(results, key=lambda r: r.cost)
    if not np.isfinite(best.cost):
        raise SearchError(
            "No candidate of any run could be simulated: the outputs were not finite anywhere in the box. "
            "Check the equations at the middle of the bounds with `plantfit check`, narrow the bounds, or fill missing inputs."
        )
    x = best.x
    polished = False
    for _ in range(REWEIGHTED if len(problem.outputs) > 1 else 0):
        problem = problem.with_scales(_residual_scales(problem, x))
        x, polished = _local(problem, x, seed), True
    finer = refined_at(problem, x)
    if finer is not problem:
        problem, x, polished = finer, _local(finer, x, seed), True
    if problem.smoothing is not None and problem.smoothing.asked:
        chosen = choose_strengths(problem, x)
        problem, x, polished = chosen.problem, chosen.z, True
    x = gauss_newton(problem, x)
    if not polished:
        return problem, [_at(problem, r, x) if r is best else r for r in results]
    return problem, [_at(problem, r, x if r is best else r.x) for r in results]


def gauss_newton(problem: Problem, x: np.ndarray, most: int = 30) -> np.ndarray:
    """The last digits: Gauss-Newton steps of the coordinates inside the box, as long as the gradient falls.

    A cost that is flat to rounding hides them from a search that compares costs.
    """
    residuals, jacobian = problem.compressed(x)
    for _ in range(most):
        inside = (x > EDGE) & (x < 1 - EDGE)
        if not np.any(inside):
            break
        step = np.zeros_like(x)
        step[inside] = -np.linalg.lstsq(jacobian[:, inside], residuals, rcond=1e-12)[0]
        moved = np.clip(x + step, 0.0, 1.0)
        r, j = problem.compressed(moved)
        before, after = jacobian[:, inside].T @ residuals, j[:, inside].T @ r
        if not (np.all(np.isfinite(j)) and r @ r <= (1 + 1e-9) * (residuals @ residuals)) or np.linalg.norm(after) >= np.linalg.norm(
            before
        ):
            break
        x, residuals, jacobian = moved, r, j
    return x


def _residual_scales(problem: Problem, x: np.ndarray) -> dict[str, float]:
    residuals, start = np.asarray(problem.residuals(x)), 0
    squares: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
    for name in problem.data["drive"]:
        for output in problem.outputs:
            count = len(problem.data["index"][name][output])
            squares[output].append(residuals[start : start + count] ** 2)
            start += count
    return {o: max(1e-12, problem.scales[o] * float(np.sqrt(np.mean(np.concatenate(s))))) for o, s in squares.items()}


def _local(problem: Problem, x: np.ndarray, seed: int) -> np.ndarray:
    objective = objective_of(problem, x[None, :])
    budget = int(200 * problem.jacobian_charge)
    return minimise(objective, "least_squares", runs=1, budget=budget, seed=seed, settings={"agree": 1})[0].x


def _at(problem: Problem, result: RunResult, x: np.ndarray) -> RunResult:
    """A run's answer with its cost on the refined problem; its history keeps the costs it was made with."""
    return dataclasses.replace(result, x=x, cost=float(problem.costs(x[None, :])[0]))


def estimate_at(problem: Problem, z: np.ndarray, names: Sequence[str]) -> Estimate:
    """The parameters `names` at the cube point z (d,), with the covariance that all others being free leaves them."""
    local, at = linearise(problem, z), [problem.space.names.index(n) for n in names]
    return Estimate(tuple(names), local.values[at], local.covariance[np.ix_(at, at)])
