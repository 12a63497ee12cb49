"""One recording of a problem fitted alone: the same model, bounds, scales and steps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.trust.finish.refit import refit
from plantfit.trust.intervals.first_values import free_starts
from plantfit.trust.intervals.follow.following import followed_ranges
from plantfit.trust.intervals.linearised import linearise, residual_blocks
from plantfit.trust.intervals.parameter_rows import NOT_VISITED, parameter_rows

# twice the log-likelihood by which a basin has to be better than that of the joint answer
PREFERRED = float(special.chdtri(1.0, 0.01))


@dataclass(frozen=True)
class Estimates:
    """What one fit says: `rows` of its parameters by coordinate name, their covariance (d, d) in their units for
    `names` (d,), how many `independent` samples of all `samples` the residuals are worth, whether intervals are
    `sound`, and the RMSE of every recording, in the unit of the output, of several outputs in scales."""

    names: tuple[str, ...]
    rows: dict[str, dict[str, Any]]
    covariance: np.ndarray
    samples: int
    independent: float
    sound: bool
    rmse: dict[str, float]

    @property
    def degrees(self) -> float:
        """Degrees of freedom that are left of the independent samples."""
        return max(1.0, self.independent - len(self.names))

    def known(self, name: str) -> bool:
        """Whether the data set both ends of a parameter, so that it can be held against that of another recording."""
        row = self.rows.get(name)
        if row is None or row["standard_error"] is None or not self.sound or row["open"] or row["at_bound"]:
            return False
        return row["status"] in ("determined", "weak") and row["standard_error"] > 0


def alone(problem: Problem, name: str) -> Problem:
    """The problem of one of its recordings: the steps, scales and strengths of smoothing are those of all."""
    simulator, steps = problem.predictor.simulator, dict[str, Any](standard_errors=problem.standard_errors)
    if simulator is not None:
        hold = {
            u: "linear" if u in simulator.interpolated else "previous" for u in getattr(problem.model, "inputs", {})
        }
        steps |= {"stepper": simulator.stepper, "substeps": simulator.substeps, "hold": hold}
    own = {name: problem.experiments[name]}
    made = Problem(
        problem.model,
        own,
        problem.space.parameters,
        scales=problem.scales,
        name=f"{problem.name}, {name} alone",
        **steps,
    )
    if name in problem.mesh:
        made = made.with_mesh({name: problem.mesh[name]})
    if made.smoothing is not None and problem.smoothing is not None:
        made = made.with_smoothing(problem.smoothing.strengths)
    return made


def joint_start(problem: Problem, z: np.ndarray, own: Problem) -> np.ndarray:
    """The cube point (d,) of a recording's own problem at the joint answer z."""
    at = dict(zip(problem.space.names, np.asarray(z, dtype=float), strict=True))
    return np.array([at[n] for n in own.space.names])


def fitted_alone(
    own: Problem, start: np.ndarray, search: Callable[[Problem, np.ndarray], tuple[np.ndarray, float]]
) -> Estimates:
    """The estimates of one recording: a local fit from the joint answer `start` (d,), or the basin that a search within
    the bounds finds, where the recording prefers it beyond chance.

    Basins of one cost, as those of a model in which two parameters may be exchanged, are no disagreement. `search`
    gives a cube point (d,) and the evaluations that it took.
    """
    everything, starts = np.ones(len(start), dtype=bool), free_starts(own.unsmoothed, start, residual_blocks(own))
    z, cost = refit(own, start, everything, starts=starts)
    found, spent = search(own, start)
    other, lower = refit(own, found, everything, starts=starts)
    here = estimates(own, z, spent)
    if lower < cost and here.independent * np.log(cost / max(lower, 1e-300)) > PREFERRED:
        return estimates(own, other, spent)
    return here


def estimates(problem: Problem, z: np.ndarray, spent: float) -> Estimates:
    """What a problem says at its answer z (d,) that took `spent` evaluations."""
    local = linearise(problem, z)
    ranges = None if local.linear is None else followed_ranges(problem, z, local.linear, spent)
    unseen = [n for n, touched in zip(problem.space.names, local.touched, strict=True) if not touched]
    rows = {r["name"]: r for r in parameter_rows(problem.space, local, unseen, ranges) if r["status"] != "fixed"}
    count = sum(len(places) for outputs in problem.data["index"].values() for places in outputs.values())
    free = sum(r["status"] != NOT_VISITED for r in rows.values())
    independent = float(count) if local.linear is None else local.linear.samples
    sound = count > free if local.linear is None else local.linear.sound
    return Estimates(
        problem.space.names, rows, local.covariance, count, independent, bool(sound), recording_rmse(problem, z)
    )


def recording_rmse(problem: Problem, z: np.ndarray) -> dict[str, float]:
    """By recording the root of the mean square of what was fitted: in the unit of one output, of several in their
    scales."""
    values = np.asarray(problem.space.physical(z))
    one, found = len(problem.outputs) == 1, {}
    for name in problem.data["drive"]:
        predicted, squares = problem.predict(values, name), []
        for o in problem.outputs:
            error = predicted[o][problem.data["index"][name][o]] - problem.data["measured"][name][o]
            squares.append((error / (1.0 if one else problem.scales[o])) ** 2)
        found[name] = float(np.sqrt(np.mean(np.concatenate(squares))))
    return found
