"""The two tasks of the steam chamber as problems: constants for each opening, and tables for each opening."""

from collections.abc import Mapping

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.library.steam_chamber import steam_chamber
from plantfit.models.model import Declared, Model
from plantfit.models.text.equations import equations
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.space import Parameter

STATIC_START = {"k": 0.2, "A1": 45.0, "A2": 15.0, "Td": 0.5}  # the paper's, section IV.A
_STATIC = "x1' = x2; x2' = (k*delay(u, Td) - x1 - A1*x2)/A2; y = x1"


def static_model() -> Model:
    """Equation (2) of the paper with four constants and the bounds of its static task; lower limits of A1 and A2 are
    ours."""
    return equations(
        _STATIC,
        inputs={"u": "%"},
        states={"x1": "bar", "x2": "bar/s"},
        outputs={"y": "bar"},
        parameters={
            "k": Declared("k", "bar/%", (0.1, 20.0)),
            "A1": Declared("A1", "s", (0.1, 1000.0)),
            "A2": Declared("A2", "s^2", (0.1, 1000.0)),
            "Td": Declared("Td", "s", (0.0, 1.0)),
        },
        name="steam_chamber_static",
        sentence="Steam-filled chamber: second order with dead time, four constants.",
        source="Metaheuristic-Based Model Optimization of a Steam-Filled Chamber (research article), eqs. (2) and (3)",
    )


def static_problem(
    recordings: Mapping[str, Recording],
    *,
    until: float = np.inf,
    dead_time: tuple[float, float] | float = (0.0, 1.0),
    substeps: int = 1,
) -> Problem:
    """k, A1, A2, Td of each opening, from its samples in (0, until] s; `dead_time` bounds Td (s), one number holds it.

    Its cost is the mean over all samples; `total_cost` is the paper's. For one opening both are the same.
    """
    own = {n: Parameter(per_recording=True, start=STATIC_START[n]) for n in ("k", "A1", "A2")}
    held = isinstance(dead_time, float | int)
    own["Td"] = (
        Parameter(value=dead_time) if held else Parameter(dead_time, "s", per_recording=True, start=STATIC_START["Td"])
    )
    return Problem(static_model(), steps_from_rest(recordings, until), own, substeps=substeps, name="static")


def dynamic_problem(recordings: Mapping[str, Recording], *, weighted: bool = False, substeps: int = 1) -> Problem:
    """Tables k, A1, A2 over 10 nodes and Td of each opening: 31 parameters for each, 310 for ten.

    Its cost is the mean over all samples, with `weighted` it is `total_cost`.
    """
    own = {n: Parameter(per_recording=True) for n in ("k", "A1", "A2", "Td")}
    if not weighted:
        return Problem(steam_chamber(), steps_from_rest(recordings), own, substeps=substeps, name="dynamic")
    scale = {"y": len(recordings) ** -0.5}  # the sum over openings in place of their mean
    return Problem(
        steam_chamber(),
        steps_from_rest(recordings),
        own,
        balance="recordings",
        scales=scale,
        substeps=substeps,
        name="dynamic",
    )


def total_cost(problem: Problem, z: np.ndarray) -> float:
    """Equation (7) at a cube point (d,): the sum over openings of the mean squared error, bar^2."""
    return float(sum(opening_costs(problem, z).values()))


def opening_costs(problem: Problem, z: np.ndarray) -> dict[str, float]:
    """Mean squared error (bar^2) of every opening at a cube point (d,)."""
    squares, costs, start = (problem.scales["y"] * np.asarray(problem.residuals(z))) ** 2, {}, 0
    for name in problem.data["drive"]:
        count, weight = len(problem.data["index"][name]["y"]), 1.0 if problem.weights is None else problem.weights[name]
        costs[name], start = float(np.mean(squares[start : start + count])) / weight, start + count
    return costs


def tables_from_static(problem: Problem, static: Mapping[str, float]) -> np.ndarray:
    """The cube point (d,) of a dynamic problem whose tables are the constants `static` ("k[opening10]": ...), inside
    its box."""
    values = [
        static[c.parameter if c.recording is None else f"{c.parameter}[{c.recording}]"]
        for c in problem.space.coordinates
    ]
    return np.clip(problem.space.cube(values), 0.0, 1.0)


def steps_from_rest(recordings: Mapping[str, Recording], until: float = np.inf) -> dict[str, Experiment]:
    """Steps from rest; the sample at t = 0 is not scored, as in the paper."""
    before = {"u": 0.0}
    return {
        n: Experiment(r, fit=(0.5 * float(r.t[1] - r.t[0]), until + 1e-6), before=before) for n, r in recordings.items()
    }
