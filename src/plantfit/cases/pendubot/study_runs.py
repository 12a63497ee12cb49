"""The runs of the paper's study: every method many times with the same budget, measured by its gap to the optimum."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import plantfit.runtime  # noqa: F401
from plantfit.models.regression import LinearModel
from plantfit.optimize import minimise
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem
from plantfit.problem.compress import Compressed
from plantfit.study.objective import objective_of
from plantfit.study.statistics import Interval, wilson_interval
from plantfit.trust import LinkNames, certified_floor, constrained_optimum

LABELS = {"pso": "PSO", "cga": "CGA", "salp_swarm": "SSA", "least_squares": "bounded least squares"}
LINKS = (LinkNames("m1", "lc1", "I1"), LinkNames("m2", "lc2", "I2"))
CLOSE = 1e-3  # relative gap of the RMSE that counts as the optimum
CHUNKS = 20  # parts of the runs that share a compiled loop and whose time is measured together, of at least SMALLEST runs
SMALLEST = 10
MARGIN = 1e-6  # of the box, that a start keeps from the bounds


@dataclass(frozen=True)
class Floor:
    """The constrained least-squares optimum: `rmse` (N m), its parameters, and what proves it."""

    rmse: float
    values: dict[str, float]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class MethodRuns:
    """Runs of one method: final `rmse` (n,) in the output's unit, `gap` (n,) to the optimum, relative; physical `answers` (n, d);
    `seconds` (chunks,) a run, those of each chunk shared out evenly; `compilation` (s) before the first; `results` of the search."""

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
        told.append(certified_floor(triangle, model.base, space.names, space.lower, space.upper, LINKS, found.cost).sentence)
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
) -> MethodRuns:
    """`runs` seeded runs of one method, called `label`; the first chunk is made twice, so that compiling is timed apart."""
    objective, results, seconds = objective_of(problem), [], []
    chosen, chunk = dict(settings), max(SMALLEST, -(-runs // CHUNKS))

    def made(first: int) -> tuple[list[RunResult], float]:
        began, count = time.perf_counter(), min(chunk, runs - first)
        found = minimise(objective, method, runs=count, first_run=first, budget=budget, seed=seed, settings=chosen, progress=progress)
        return list(found), time.perf_counter() - began

    compilation = made(0)[1]
    for first in range(0, runs, chunk):
        found, spent = made(first)
        results += found
        seconds.append(spent / len(found))
    rmse = np.sqrt([r.cost for r in results])
    answers = np.asarray(problem.space.physical(np.array([r.x for r in results])))
    name = label or LABELS.get(method, method)
    return MethodRuns(method, name, rmse, rmse / floor.rmse - 1.0, answers, np.array(seconds), compilation, tuple(results))


def refined(problem: Problem, floor: Floor, points: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Gap (n,) where bounded least squares (scipy's trust region) ends that begins at cube points (n, d)."""

    @lru_cache(maxsize=2)
    def at(z: bytes) -> tuple[np.ndarray, np.ndarray]:
        [(residuals, jacobian)] = problem.compiled["blocks"](np.frombuffer(z), problem.arguments)
        return np.asarray(residuals) / floor.rmse, np.asarray(jacobian) / floor.rmse

    tight: Any = {"jac": lambda z: at(z.tobytes())[1], "xtol": 1e-15, "ftol": 1e-13, "gtol": 1e-15, "bounds": (0.0, 1.0), "max_nfev": 500}
    inside = np.clip(np.asarray(points, dtype=float), MARGIN, 1 - MARGIN)
    found = [least_squares(lambda z: at(z.tobytes())[0], z, **tight) for z in inside]
    return np.array([np.sqrt(np.mean(f.fun**2)) - 1.0 for f in found])
