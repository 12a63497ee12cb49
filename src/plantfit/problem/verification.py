"""How exact the simulation is at a point of the box: every recording against a tight solver."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive
from plantfit.simulate.verify import check_steps

FINEST = 256


@dataclass(frozen=True)
class Verified:
    """Errors of one output of one recording in its unit, over `samples` samples, with `substeps` steps between two."""

    recording: str
    output: str
    max_error: float
    rms_error: float
    samples: int
    substeps: int
    checked_with: str


def verify(problem: Problem, z: np.ndarray, tolerance: float | None = None) -> list[Verified]:
    """Compare with scipy's Radau (rtol 1e-9) at a cube point (d,); static and steady records have no steps and are left out.

    With a `tolerance` (unit of the outputs) the steps of each recording are halved until its largest error is below it, or
    they are 256. Where Radau does not follow the model (resets, dry friction, backlash, late states) or fails,
    the error is estimated by halving the steps.
    """
    values = problem.space.physical(np.asarray(z, dtype=float))
    found = []
    for name, drive in problem.data["drive"].items():
        if isinstance(drive, Drive) and problem.predictor.has_steps:
            found += _of_recording(problem, name, problem.space.tree(values, name), tolerance)
    return found


def _of_recording(problem: Problem, name: str, p: Any, tolerance: float | None) -> list[Verified]:
    variant = problem
    while True:
        simulator = variant.predictor.stepping()
        error = check_steps(simulator, p, variant.data["drive"][name])
        if tolerance is None or max(error.max_error.values()) < tolerance or simulator.substeps >= FINEST:
            count = error.last - error.first + 1
            return [
                Verified(name, o, error.max_error[o], error.rms_error[o], count, simulator.substeps, error.checked_with)
                for o in problem.outputs
            ]
        variant = variant.with_simulator(simulator.refined(2))


def point(problem: Problem, named: dict[str, float]) -> np.ndarray:
    """A cube point (d,) from values by name, in their units; what is not named stays in the middle of its bounds.

    A parameter with entries or one value per recording can be named as a whole. Raises SpaceError.
    """
    space = problem.space
    z = np.full(space.dimension, 0.5)
    for name, value in named.items():
        places = [i for i, c in enumerate(space.coordinates) if name in (c.name, c.parameter)]
        if not places:
            raise SpaceError(
                f"There is no free parameter {name!r}; there are {', '.join(dict.fromkeys(c.parameter for c in space.coordinates))}."
            )
        for i in places:
            c = space.coordinates[i]
            if not c.lower <= value <= c.upper:
                raise SpaceError(f"{c.name} = {value:g} is outside its bounds [{c.lower:g}, {c.upper:g}].")
            whole = np.array(space.physical(z))
            whole[i] = value
            z[i] = space.cube(whole)[i]
    return z
