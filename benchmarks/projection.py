"""`python -m benchmarks.projection`: one local search with and without variable projection, from given and from random
starts.

scipy's trf over the cube, on all coordinates, on the nonlinear ones with Kaufman's derivatives, and with those of Golub
and Pereyra. A search has succeeded where its cost is within 1e-6 of the best known. Boxes of the NIST regressions reach
10 times the larger published start to both sides. QUICK=1 takes fewer starts.
"""

import importlib.util
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

import plantfit.runtime  # noqa: F401
from plantfit.models import equations, second_order
from plantfit.problem import Problem, Projection
from plantfit.recording.record import Recording, Signal
from plantfit.simulate import Simulator
from plantfit.space import Parameter

ROOT = Path(__file__).resolve().parents[1]
REACHED, MOST = 1e-6, 400
STARTS, QUICK_STARTS = 40, 5


class Case(NamedTuple):
    """`starts` (k, d) are published ones; `best` is a cost that is known, else the least that is found."""

    name: str
    problem: Problem
    starts: np.ndarray
    best: float | None


class Search(NamedTuple):
    """Where a search ended, and how often rows and derivatives were asked for."""

    cost: float
    calls: int


def nist() -> list[Case]:
    """The eight regressions of `tests/nist`."""
    spec = importlib.util.spec_from_file_location("nist_specs", ROOT / "tests" / "nist" / "nist_specs.py")
    assert spec is not None
    assert spec.loader is not None
    specs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(specs)
    cases = []
    for name, (formula, _) in specs.MODELS.items():
        values, squares, rows = specs.certified(name)
        reach = {n: 10.0 * max(abs(a), abs(b)) for n, (a, b, _) in values.items()}
        bounds = {n: {"bounds": (-v, v)} for n, v in reach.items()}
        model = equations(f"y = {formula}", inputs=["x"], outputs=["y"], parameters=bounds)
        record = Recording(np.arange(float(len(rows))), {"x": Signal(rows[:, 1]), "y": Signal(rows[:, 0])}, name)
        problem = Problem(model, record)
        starts = [problem.space.cube([values[n][k] for n in problem.space.names]) for k in (0, 1)]
        cases.append(Case(name, problem, np.array(starts), squares / len(rows)))
    return cases


def exponentials() -> Case:
    """Three decays with noise."""
    rng, t = np.random.default_rng(0), np.linspace(0.0, 6.0, 80)
    y = 2.0 * np.exp(-0.4 * t) - 3.0 * np.exp(-1.5 * t) + 4.0 * np.exp(-6.0 * t) + 2e-3 * rng.normal(size=len(t))
    bounds = {n: {"bounds": (-40.0, 40.0)} for n in ("a", "b", "c")} | {
        n: {"bounds": (0.0, 60.0)} for n in ("p", "q", "r")
    }
    model = equations("y = a*exp(-p*x) + b*exp(-q*x) + c*exp(-r*x)", inputs=["x"], outputs=["y"], parameters=bounds)
    return Case(
        "three decays", Problem(model, Recording(t, {"x": Signal(t), "y": Signal(y)}, "decays")), np.zeros((0, 6)), None
    )


def process() -> Case:
    """Second order with gain, offset and dead time."""
    rng, t = np.random.default_rng(1), 0.1 * np.arange(400)
    u = np.repeat(rng.uniform(-1.0, 1.0, 10), 40)
    model = second_order(initial="free")
    simulator = Simulator.of(model, substeps=4)
    truth = {"K": 2.0, "tau1": 1.5, "tau2": 0.4, "L": 0.73, "c": 5.0, "y0": 4.0}
    y = np.asarray(simulator.outputs(truth, simulator.drive(t, {"u": u}))["y"]) + 0.02 * rng.normal(size=len(t))
    wide = {n: (-100.0, 100.0) for n in ("K", "c", "y0")} | {
        n: Parameter((0.02, 50.0), scale="log") for n in ("tau1", "tau2")
    }
    return Case("second order", Problem(model, Recording(t, {"u": Signal(u), "y": Signal(y)}, "plant"),
                                        {**wide, "L": (0.0, 4.0)}),
                np.zeros((0, 6)), None)  # fmt: skip


def searched(rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], start: np.ndarray) -> Search:
    """One search by trf; rows give residuals (k,) whose mean square is the cost, and derivatives (k, d)."""
    kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if z.tobytes() not in kept:
            kept.clear()
            kept[z.tobytes()] = rows(z)
            calls[0] += 1
        return kept[z.tobytes()]

    calls = [0]
    if len(start) == 0:
        return Search(float(np.mean(at(start)[0] ** 2)), 1)
    try:
        found = least_squares(
            lambda z: at(z)[0], np.clip(start, 1e-9, 1 - 1e-9), lambda z: at(z)[1], bounds=(0.0, 1.0),
            xtol=1e-14, ftol=1e-14, gtol=1e-15, max_nfev=MOST,
        )  # fmt: skip
    except (ValueError, np.linalg.LinAlgError):
        return Search(np.inf, calls[0])
    return Search(2.0 * found.cost / len(found.fun), calls[0])


def ways(problem: Problem) -> dict[str, tuple[Callable, Callable]]:
    """Rows by name, and what of a cube point they take."""

    def of(projection: Projection) -> tuple[Callable, Callable]:
        def rows(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            found = projection.rows(z)
            return found.r[0], found.jacobian[0]

        return rows, projection.restrict

    found: dict[str, Any] = {"all": (problem.compressed, lambda z: z)}
    for name, full in (("kaufman", False), ("full", True)):
        projection = Projection.of(problem, full=full)
        if projection is not None:
            found[name] = of(projection)
    return found


def compared(case: Case, starts: int) -> dict[str, list[tuple[Search, float]]]:
    """Every way from every start, with its seconds."""
    rng = np.random.default_rng(7)
    points = np.concatenate([case.starts, rng.uniform(size=(starts, case.problem.space.dimension))])
    found: dict[str, list[tuple[Search, float]]] = {}
    for name, (rows, restrict) in ways(case.problem).items():
        searched(rows, restrict(points[-1]))  # compiles
        found[name] = []
        for z in points:
            began = time.perf_counter()
            end = searched(rows, restrict(z))
            found[name].append((end, time.perf_counter() - began))
    return found


def main() -> None:
    starts = QUICK_STARTS if os.environ.get("QUICK", "") not in ("", "0") else STARTS
    print(
        f"{starts} random starts; calls: median of rows with derivatives "
        "asked for, in searches that succeed; ms: of a call\n"
    )
    print(
        "| problem | solved for | way | published starts | random starts | calls | ms |\n|---|---|---|---|---|---|---|"
    )
    for case in (*nist(), exponentials(), process()):
        found = compared(case, starts)
        projection = Projection.of(case.problem)
        linear = f"{len(projection.solved)} of {case.problem.space.dimension}" if projection else "none"
        least = min(end.cost for ends in found.values() for end, _ in ends)
        target = (least if case.best is None else case.best) * (1.0 + REACHED)
        given = len(case.starts)
        for name, ends in found.items():
            good = [end.cost <= target for end, _ in ends]
            calls = [end.calls for (end, _), ok in zip(ends, good, strict=True) if ok]
            each = 1e3 * sum(s for _, s in ends) / max(sum(end.calls for end, _ in ends), 1)
            print(
                f"| {case.name} | {linear} | {name} | {sum(good[:given])} of {given} | {sum(good[given:])} of "
                f"{len(good) - given} "
                f"| {np.median(calls) if calls else float('nan'):.0f} | {each:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
