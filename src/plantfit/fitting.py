"""The short way: `fit(problem)` and its `Answer`."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.estimate import Estimate
from plantfit.optimize import minimise
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.problem.shooting import Shooting
from plantfit.problem.steps import choose_substeps
from plantfit.report import summary_text, write_report
from plantfit.study.objective import objective_of
from plantfit.study.plan import default_budget
from plantfit.trust.assess import assess
from plantfit.trust.descent import gauss_newton as gauss_newton
from plantfit.trust.finish import finish
from plantfit.trust.local import linearise
from plantfit.trust.parameter_uncertainty import check_errors
from plantfit.trust.shared_error import SharedError


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

    Chooses the step of the simulation, searches, estimates from the residuals the scale of every output that was given none when
    there are several outputs, checks the step at the answer, and brings every run to its end on that final problem. With
    `shooting` every record is
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
    problem, results = finish(problem, results)
    seconds = {"prepare": prepared - started, "search": searched - prepared, "finish": time.perf_counter() - searched}
    return Answer(problem, results, seed, spec, command, seconds, tuple(errors), draws)


def shooting_starts(problem: Problem, segments: int | None, seed: int) -> np.ndarray | None:
    """Where multiple shooting with so many segments a record ends (1, d); None without segments."""
    return None if segments is None else Shooting.of(problem, segments=segments).search(seed=seed).z[None, :]


def prepare(problem: Problem) -> Problem:
    """Choose the substeps of the simulation; the same for the same problem, so that a resumed study repeats it."""
    return choose_substeps(problem)


def estimate_at(problem: Problem, z: np.ndarray, names: Sequence[str]) -> Estimate:
    """The parameters `names` at the cube point z (d,), with the covariance that all others being free leaves them."""
    local, at = linearise(problem, z), [problem.space.names.index(n) for n in names]
    return Estimate(tuple(names), local.values[at], local.covariance[np.ix_(at, at)])
