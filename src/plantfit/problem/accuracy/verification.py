"""How exact the simulation is at a point of the box: every recording against a tight solver."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem.accuracy.step_errors import step_errors
from plantfit.problem.evaluate.points import residuals
from plantfit.problem.problem import Problem
from plantfit.simulate.check.tight import EVALUATIONS, Stopped, Tight, follow
from plantfit.simulate.check.verify import check_steps
from plantfit.simulate.simulator import Drive

FINEST = 256
KEPT = 40  # records followed by the tight solver that are kept
CLOSE = 0.01  # of the cost: how far the reported one may be from that of the tight solver
NOTHING = 1e-5  # of the spread of the measured outputs: a residual (rms) that is nothing, as of data without noise


@dataclass(frozen=True)
class Verified:
    """Errors of one output of one recording in its unit, over `samples` samples, with `substeps` steps between two (of the fineness
    `substeps`, where `stepper` is "adaptive")."""

    recording: str
    output: str
    max_error: float
    rms_error: float
    samples: int
    substeps: int | float
    checked_with: str
    stepper: str = "exponential"
    refused: str | None = None  # where the tight solver could not follow, and what the state did there


def verify(problem: Problem, z: np.ndarray, tolerance: float | None = None) -> list[Verified]:
    """Compare with solvers of scipy (rtol 1e-9, see `simulate.check.tight`) over the whole of every recording at a cube point (d,).

    Static and steady records have no steps and are left out.

    With a `tolerance` (unit of the outputs) the steps of each recording are halved until its largest error is below it, or
    they are 256. Events, dry friction, backlash and late states are followed too; where the solver cannot, `refused` says so.
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
        if tolerance is None or error.stopped is not None or max(error.max_error.values()) < tolerance or simulator.substeps >= FINEST:
            count = error.last - error.first + 1
            refused = None if error.stopped is None else error.stopped.sentence
            return [
                Verified(
                    name,
                    o,
                    error.max_error[o],
                    error.rms_error[o],
                    count,
                    variant.steps_a_sample,
                    error.checked_with,
                    simulator.stepper,
                    refused,
                )
                for o in problem.outputs
            ]
        variant = variant.with_simulator(simulator.refined(2))


@dataclass(frozen=True)
class CheckedCost:
    """The cost of the data (mean square of the scaled residuals) as simulated, and by the tight solver over all fitted samples.

    `stopped` maps recordings to where the solver could not follow them; `cost_checked` is then infinite.
    """

    cost_reported: float
    cost_checked: float
    stopped: dict[str, Stopped]
    evaluations: int
    samples: int  # compared: those reached with the evaluations allowed, of which both costs are
    floor: float = 0.0  # a cost that is nothing beside the outputs

    @property
    def refused(self) -> str | None:
        """One sentence where the answer exists in the integrator only."""
        for name, stopped in self.stopped.items():
            return f"The answer is refused: in recording {name}, {stopped.sentence}."
        return None

    @property
    def off(self) -> float:
        """How far the reported cost is from the checked one, as a share of it."""
        return abs(self.cost_reported - self.cost_checked) / max(self.cost_checked, 1e-300) if np.isfinite(self.cost_checked) else np.inf

    @property
    def confirmed(self) -> bool:
        """Whether the costs agree to 1 %; if not, the fit has to go on with finer steps, or is refused."""
        return self.off <= CLOSE or max(self.cost_reported, self.cost_checked) <= self.floor


def followed(problem: Problem, z: np.ndarray, name: str, evaluations: int) -> Tight:
    """One moving recording by the tight solver at a cube point (d,); the last ones are kept with the problem."""
    kept, at = problem.once("followed", dict), (name, np.asarray(z, dtype=float).tobytes())
    key = (*at, evaluations)
    whole = next((k for k, v in kept.items() if k[:2] == at and not (v.stopped and v.stopped.spent)), key)
    if whole in kept:
        return kept[whole]
    if key not in kept:
        if len(kept) >= KEPT:
            kept.clear()
        values = problem.space.physical(np.asarray(z, dtype=float))
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        kept[key] = follow(problem.predictor.stepping(), p, problem.data["drive"][name], evaluations=evaluations)
    return kept[key]


def least_exact(problem: Problem, z: np.ndarray) -> list[str]:
    """The moving recordings at a cube point (d,), that with the largest step error by halving the steps first."""
    moving = [n for n, d in problem.data["drive"].items() if isinstance(d, Drive)]
    if len(moving) < 2:
        return moving
    error, start, found = step_errors(problem, z), 0, {}
    for name in problem.data["drive"]:
        count = sum(len(problem.data["index"][name][o]) for o in problem.outputs)
        found[name] = float(np.mean(error[start : start + count] ** 2)) if count else 0.0
        start += count
    return sorted(moving, key=lambda n: -found[n] if np.isfinite(found[n]) else -np.inf)


def checked_cost(
    problem: Problem, z: np.ndarray, *, evaluations: int = EVALUATIONS, recordings: Collection[str] | None = None
) -> CheckedCost:
    """The cost at a cube point (d,) by an independent solver; static and steady records have no steps and count as they are.

    `evaluations` of the rate are spent on each recording at most; what lies behind is left out of both costs, and so are all but
    `recordings` where these are given.
    Of residuals that are nearly zero, 1 % of a cost is less than the solver's own tolerance; see `CheckedCost.off` for the number.
    """
    reported = np.asarray(residuals(problem, z))
    tight, begin, stopped, spent = reported.copy(), 0, {}, 0
    for name, drive in problem.data["drive"].items():
        moving = isinstance(drive, Drive) and problem.predictor.has_steps
        found, chosen = None, recordings is None or name in recordings
        if moving and chosen:
            found = followed(problem, z, name, evaluations)
            spent += found.evaluations
            if found.stopped is not None and not found.stopped.spent:
                stopped[name] = found.stopped
        weight = 1.0 if problem.weights is None else problem.weights[name]
        for output in problem.outputs:
            index, measured = problem.data["index"][name][output], problem.data["measured"][name][output]
            if found is not None:
                tight[begin : begin + len(index)] = np.sqrt(weight) * (found.outputs[output][index] - measured) / problem.scales[output]
            elif not chosen:
                tight[begin : begin + len(index)] = np.nan
            begin += len(index)
    floor = NOTHING**2 * float(np.mean(_spreads(problem) ** 2))
    known = np.isfinite(tight)
    if stopped or not np.any(known):
        return CheckedCost(float(np.mean(reported**2)), np.inf, stopped, spent, int(np.sum(known)), floor)
    cost, checked = (float(np.mean(r[known] ** 2)) for r in (reported, tight))
    return CheckedCost(cost, checked, stopped, spent, int(np.sum(known)), floor)


def _spreads(problem: Problem) -> np.ndarray:
    """Of the scaled measured outputs, one for each output of each recording."""
    measured = [(o, y) for own in problem.data["measured"].values() for o, y in own.items() if len(y)]
    return np.array([np.std(y) / problem.scales[o] for o, y in measured])


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
                raise SpaceError(f"{c.name} = {value:g} is outside its bounds [{c.lower:g}, {c.upper:g}]; give a value inside.")
            whole = np.array(space.physical(z))
            whole[i] = value
            z[i] = space.cube(whole)[i]
    return z
