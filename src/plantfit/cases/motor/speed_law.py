"""What speed and voltage tell of a motor: the coefficients of one differential equation of the speed.

Without the current the two equations of the motor join to

    Lm Jm/K w'' + (Rm Jm + Lm Cm)/K w' + (Rm Cm + K^2)/K w + Rm Tf/K sgn(w) = V,     K = Kt = Kb,

in which Lm Tf/K d/dt sgn(w) is left out, an impulse of microvolt seconds here. With Kt free, K^2 is Kt Kb and the rest
over Kt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models import equations
from plantfit.models.library.speed_law import EDGE, EQUATIONS, LAW, UNITS, speed_law
from plantfit.models.model import Model
from plantfit.optimize import minimise
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.study.objective import objective_of
from plantfit.trust import linearise

LABELS = ("(Rm Cm + K^2)/K", "(Rm Jm + Lm Cm)/K", "Lm Jm/K", "Rm Tf/K")
BOXES = {"c0": (0.02, 2.0), "c1": (0.005, 1.0), "c2": (1e-5, 0.05), "f": (-0.5, 0.5)}
SUBSTEPS = 4


def coefficients(p: Mapping[str, Any]) -> list[Any]:
    """The four coefficients of motor constants by name, Kt taken as Kb where it is not given."""
    return speed_law(p)


def law_model() -> Model:
    """The equation above for simulation, from rest; input V, output w."""
    states = {"w": {"unit": "rad/s", "initial": 0}, "a": {"unit": "rad/s^2", "initial": 0}}
    kinds = {
        n: {"unit": u, "bounds": BOXES[n], "scale": "linear" if n == "f" else "log"}
        for n, u in zip(LAW, UNITS, strict=True)
    }
    signals = {"inputs": {"V": "V"}, "states": states, "outputs": {"w": "rad/s"}}
    return equations(EQUATIONS, **signals, parameters=kinds, constants={"edge": EDGE}, name="speed law")


@dataclass(frozen=True)
class Laws:
    """Coefficients (records, 4) in the order of LAW, and covariances (records, 4, 4) of each record's estimate."""

    values: np.ndarray
    covariance: np.ndarray


def fitted_laws(records: Sequence[Recording], seed: int = 1) -> Laws:
    """Least squares of the law on each record of V and w, all in one compiled program."""
    named = {f"r{k}": _only(r) for k, r in enumerate(records)}
    space = {
        n: Parameter(BOXES[n], u, "linear" if n == "f" else "log", per_recording=len(named) > 1)
        for n, u in zip(LAW, UNITS, strict=True)
    }
    problem = Problem(law_model(), named, space, substeps=SUBSTEPS)
    found = minimise(objective_of(problem), "auto", budget=int(200 * problem.jacobian_charge), seed=seed)[0]
    local = linearise(problem, found.x)
    at = [[_place(problem, n, name) for n in LAW] for name in named]
    return Laws(local.values[at], np.array([local.covariance[np.ix_(row, row)] for row in at]))


def _place(problem: Problem, parameter: str, name: str) -> int:
    full = f"{parameter}[{name}]" if f"{parameter}[{name}]" in problem.space.names else parameter
    return problem.space.names.index(full)


def _only(r: Recording) -> Recording:
    return Recording(r.t, {"V": r.signals["V"], "w": r.signals["w"]}, r.name)


def with_speed(recording: Recording, speed: np.ndarray) -> Recording:
    """The recording with another speed (n,)."""
    return Recording(recording.t, {**recording.signals, "w": Signal(speed, "rad/s")}, recording.name, recording.log)
