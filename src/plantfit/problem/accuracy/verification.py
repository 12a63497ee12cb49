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
from plantfit.simulate.check.verify import StepError, check_steps
from plantfit.simulate.simulator import Drive

FINEST = 256
KEPT = 40  # records followed by the tight solver that are kept
CLOSE = 0.01  # of the cost: how far the reported one may be from that of the tight solver
RTOL, ATOL = 1e-9, 1e-11  # of the tight solver, `ATOL` as a share of the largest size of each state
# of these, where the simulation is not what the tight solver gives: either may be the one that is off
TIGHTER = (1e-2, 1e-4)
SURE = 0.3  # of a difference: a change of the tight solution by less, for which it is that of the simulation
NOTICED = (
    0.05  # of the residual (rms): what a simulation may be off in a recording before the tight solver is asked again
)
NOTHING = 1e-5  # of the spread of the measured outputs: a residual (rms) that is nothing, as of data without noise


@dataclass(frozen=True)
class Verified:
    """Errors of one output of one recording in its unit, over `samples` samples, with `substeps` steps between two
    (of the fineness `substeps`, where `stepper` is "adaptive")."""

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
    """Compare with solvers of scipy (rtol 1e-9, see `simulate.check.tight`) over the whole of every recording at a cube
    point (d,).

    Static and steady records have no steps and are left out.

    With a `tolerance` (unit of the outputs) the steps of each recording are halved until its largest error is below it,
    or they are 256. Events, dry friction, backlash and late states are followed too; where the solver cannot, `refused`
    says so.
    """
    found = []
    for name, drive in problem.data["drive"].items():
        if isinstance(drive, Drive) and problem.predictor.has_steps:
            found += _of_recording(problem, name, z, tolerance)
    return found


def error_of(problem: Problem, z: np.ndarray, name: str, evaluations: int = EVALUATIONS) -> StepError:
    """The error of one moving recording at a cube point (d,) against the tight solver.

    Where it is more than 5 % of the residual, the tight solver is asked again with tolerances of 1e-11 and 1e-13, until
    it agrees with itself: along an unstable course its own errors grow as well.
    """
    simulator, drive = problem.predictor.stepping(), problem.data["drive"][name]
    p = {
        k: np.asarray(v)
        for k, v in problem.space.tree(problem.space.physical(np.asarray(z, dtype=float)), name).items()
    }
    error = check_steps(simulator, p, drive, tight=followed(problem, z, name, evaluations))
    for tighter in TIGHTER:
        if error.stopped is not None or not _noticed(problem, name, p, error):
            break
        again = check_steps(simulator, p, drive, tight=followed(problem, z, name, evaluations, tighter))
        if again.stopped is not None or again.last < error.last:
            break
        sure = all(abs(again.rms_error[o] - e) <= SURE * again.rms_error[o] for o, e in error.rms_error.items())
        error = again
        if sure:
            break
    return error


def _noticed(problem: Problem, name: str, p: Any, error: StepError) -> bool:
    """Whether any output is off by more than 5 % of the residual (rms) of this recording."""
    simulated, data = problem.outputs_over(name, p), problem.data
    for output, off in error.rms_error.items():
        index, measured = data["index"][name][output], data["measured"][name][output]
        residual = simulated[output][index] - measured
        if len(index) and not off <= NOTICED * float(np.sqrt(np.mean(residual**2))):
            return True
    return False


def _of_recording(problem: Problem, name: str, z: np.ndarray, tolerance: float | None) -> list[Verified]:
    variant = problem
    while True:
        simulator = variant.predictor.stepping()
        error = error_of(variant, z, name)
        if (
            tolerance is None
            or error.stopped is not None
            or max(error.max_error.values()) < tolerance
            or simulator.substeps >= FINEST
        ):
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
    """The cost of the data (mean square of the scaled residuals) as simulated, and by the tight solver over all fitted
    samples.

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
        return (
            abs(self.cost_reported - self.cost_checked) / max(self.cost_checked, 1e-300)
            if np.isfinite(self.cost_checked)
            else np.inf
        )

    @property
    def confirmed(self) -> bool:
        """Whether the costs agree to 1 %; if not, the fit has to go on with finer steps, or is refused."""
        return self.off <= CLOSE or max(self.cost_reported, self.cost_checked) <= self.floor


def followed(problem: Problem, z: np.ndarray, name: str, evaluations: int, tighter: float = 1.0) -> Tight:
    """One moving recording by the tight solver at a cube point (d,), with its tolerances times `tighter`; the last
    ones are kept with the problem."""
    kept, at = problem.once("followed", dict), (name, np.asarray(z, dtype=float).tobytes(), tighter)
    key = (*at, evaluations)
    whole = next((k for k, v in kept.items() if k[:3] == at and not (v.stopped and v.stopped.spent)), key)
    if whole in kept:
        return kept[whole]
    if key not in kept:
        if len(kept) >= KEPT:
            kept.clear()
        values = problem.space.physical(np.asarray(z, dtype=float))
        p = {k: np.asarray(v) for k, v in problem.space.tree(values, name).items()}
        kept[key] = follow(
            problem.predictor.stepping(), p, problem.data["drive"][name],
            rtol=RTOL * tighter, atol=ATOL * tighter, evaluations=evaluations,
            others=(d for d in problem.data["drive"].values() if isinstance(d, Drive)),
        )  # fmt: skip
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
    """The cost at a cube point (d,) by an independent solver; static and steady records have no steps and count as they
    are.

    `evaluations` of the rate are spent on each recording at most; what lies behind is left out of both costs, and so
    are all but `recordings` where these are given. Of residuals that are nearly zero, 1 % of a cost is less than the
    solver's own tolerance; see `CheckedCost.off` for the number.

    Along an unstable course small errors grow a thousandfold, those of the tight solver, too. So where the costs differ
    it is asked again with tolerances of 1e-11 and 1e-13, until its own cost changes by little beside the difference.
    """
    reported = np.asarray(residuals(problem, z))
    told = _checked(problem, z, reported, evaluations, recordings, 1.0)
    for tighter in TIGHTER:
        if told.confirmed or not np.isfinite(told.cost_checked):
            break
        again = _checked(problem, z, reported, evaluations, recordings, tighter)
        if again.samples != told.samples or not np.isfinite(
            again.cost_checked
        ):  # it has not come as far: nothing is compared
            break
        change, told = abs(again.cost_checked - told.cost_checked), again
        if change <= SURE * abs(again.cost_reported - again.cost_checked):
            break
    return told


def _checked(
    problem: Problem,
    z: np.ndarray,
    reported: np.ndarray,
    evaluations: int,
    recordings: Collection[str] | None,
    tighter: float,
) -> CheckedCost:
    """`checked_cost` by the tight solver with its tolerances times `tighter`; `reported` (m,) are the scaled
    residuals as simulated."""
    tight, begin, stopped, spent = reported.copy(), 0, {}, 0
    for name, drive in problem.data["drive"].items():
        moving = isinstance(drive, Drive) and problem.predictor.has_steps
        found, chosen = None, recordings is None or name in recordings
        if moving and chosen:
            found = followed(problem, z, name, evaluations, tighter)
            spent += found.evaluations
            if found.stopped is not None and not found.stopped.spent:
                stopped[name] = found.stopped
        weight = 1.0 if problem.weights is None else problem.weights[name]
        for output in problem.outputs:
            index, measured = problem.data["index"][name][output], problem.data["measured"][name][output]
            if found is not None:
                tight[begin : begin + len(index)] = (
                    np.sqrt(weight) * (found.outputs[output][index] - measured) / problem.scales[output]
                )
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
                f"There is no free parameter {name!r}; there are "
                f"{', '.join(dict.fromkeys(c.parameter for c in space.coordinates))}."
            )
        for i in places:
            c = space.coordinates[i]
            if not c.lower <= value <= c.upper:
                raise SpaceError(
                    f"{c.name} = {value:g} is outside its bounds [{c.lower:g}, {c.upper:g}]; give a value inside."
                )
            whole = np.array(space.physical(z))
            whole[i] = value
            z[i] = space.cube(whole)[i]
    return z
