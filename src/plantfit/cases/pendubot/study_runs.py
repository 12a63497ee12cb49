"""The runs of the paper's study: every method many times with the same budget, measured by its gap to the optimum."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

import plantfit.runtime  # noqa: F401
from plantfit.models.library.regression import LinearModel
from plantfit.optimize import minimise
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem
from plantfit.problem.evaluate.compress import Compressed
from plantfit.study.comparing.statistics import Interval, wilson_interval
from plantfit.study.objective import objective_of
from plantfit.trust import LinkNames, certified_floor, constrained_optimum

LABELS = {"pso": "PSO", "cga": "CGA", "salp_swarm": "SSA", "least_squares": "bounded least squares"}
LINKS = (LinkNames("m1", "lc1", "I1"), LinkNames("m2", "lc2", "I2"))
CLOSE = 1e-3  # relative gap of the RMSE that counts as the optimum
CHUNKS = (
    20  # parts of the runs that share a compiled loop and whose time is measured together, of at least SMALLEST runs
)
SMALLEST = 10
STEPS, SETTLED = 400, 1e-14  # most steps of a descent, and the relative decrease that ends it
TINY = 1e-15


@dataclass(frozen=True)
class Floor:
    """The constrained least-squares optimum: `rmse` (N m), its parameters, and what proves it."""

    rmse: float
    values: dict[str, float]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class MethodRuns:
    """Runs of one method: final `rmse` (n,) in the output's unit, `gap` (n,) to the optimum, relative; physical
    `answers` (n, d); `seconds` (chunks,) a run, those of each chunk shared out evenly; `compilation` (s) before the
    first; `results` of the search."""

    name: str
    label: str
    rmse: np.ndarray
    gap: np.ndarray
    answers: np.ndarray
    seconds: np.ndarray
    compilation: float
    results: tuple[RunResult, ...]

    @property
    def share_close(self) -> tuple[float, Interval]:
        """Share of the runs within CLOSE of the optimum, and its Wilson interval."""
        hits = int(np.sum(self.gap < CLOSE))
        return hits / len(self.gap), wilson_interval(hits, len(self.gap))

    @property
    def total_seconds(self) -> float:
        return self.compilation + float(np.mean(self.seconds)) * len(self.gap)

    @property
    def best(self) -> int:
        return int(np.argmin(self.rmse))


def triangle_of(problem: Problem) -> Compressed:
    """The whole regression of a problem with one recording and one output."""
    [[triangle]] = [list(outputs.values()) for outputs in problem.data["triangles"].values()]
    return triangle


def floor_of(problem: Problem, proven: bool = True) -> Floor:
    """The optimum inside the bounds, by many starts, and with `proven` a lower bound that certifies it."""
    model, space = problem.model, problem.space
    assert isinstance(model, LinearModel)
    assert model.base is not None
    triangle = triangle_of(problem)
    found = constrained_optimum(triangle, model.base, space.names, space.lower, space.upper)
    told = [found.sentence]
    if proven:
        told.append(
            certified_floor(triangle, model.base, space.names, space.lower, space.upper, LINKS, found.cost).sentence
        )
    return Floor(found.rmse, found.values, tuple(told))


def method_runs(
    problem: Problem,
    floor: Floor,
    method: str,
    settings: Mapping[str, Any],
    runs: int,
    budget: int,
    seed: int,
    progress: Callable[[Any], None] | None = None,
    label: str | None = None,
    timed: bool = False,
) -> MethodRuns:
    """`runs` seeded runs of one method, called `label`; if `timed`, the first chunk is made twice and compiling is
    timed apart."""
    objective, results, seconds = objective_of(problem), [], []
    chosen, chunk = dict(settings), max(SMALLEST, -(-runs // CHUNKS))

    def made(first: int) -> tuple[list[RunResult], float]:
        began, count = time.perf_counter(), min(chunk, runs - first)
        found = minimise(
            objective, method, runs=count, first_run=first, budget=budget, seed=seed, settings=chosen, progress=progress
        )
        return list(found), time.perf_counter() - began

    compilation = made(0)[1] if timed else 0.0
    for first in range(0, runs, chunk):
        found, spent = made(first)
        results += found
        seconds.append(spent / len(found))
    rmse = np.sqrt([r.cost for r in results])
    answers = np.asarray(problem.space.physical(np.array([r.x for r in results])))
    name = label or LABELS.get(method, method)
    return MethodRuns(
        method, name, rmse, rmse / floor.rmse - 1.0, answers, np.array(seconds), compilation, tuple(results)
    )


def refined(problem: Problem, floor: Floor, points: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Gap (n,) where a Levenberg-Marquardt method ends that begins at cube points (n, d) and solves each step inside
    the box exactly.

    Scipy's trust region keeps off the bounds and creeps along them: it needs thousands of steps where this takes tens.
    """
    return np.array([_descended(problem, floor.rmse, np.clip(np.asarray(z, dtype=float), 0.0, 1.0)) for z in points])


def _descended(problem: Problem, unit: float, z: np.ndarray) -> float:
    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        [(residuals, jacobian)] = problem.compiled["blocks"](z, problem.arguments)
        return np.asarray(residuals) / unit, np.asarray(jacobian) / unit

    (r, slope), damping = at(z), 1e-2
    for _ in range(STEPS):
        rows = np.vstack([slope, np.sqrt(damping) * np.eye(len(z))])
        box = (-z - TINY, 1 - z + TINY)  # lsq_linear wants room between the bounds
        step = lsq_linear(rows, np.concatenate([-r, np.zeros(len(z))]), box, method="bvls").x
        moved = np.clip(z + step, 0.0, 1.0)
        r_new, slope_new = at(moved)
        fall = 1.0 - (r_new @ r_new) / (r @ r)
        if fall > 0:
            z, r, slope, damping = moved, r_new, slope_new, max(damping / 5, 1e-12)
        else:
            damping *= 4
        if 0 < fall < SETTLED or damping > 1e8:
            break
    return float(np.sqrt(np.mean(r**2)) - 1.0)
