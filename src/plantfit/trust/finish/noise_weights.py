"""The final problem with the answer of generalised least squares, where the study asks for it and the data allow it.

Errors that samples share, as those of an encoder's slots, and noise that is correlated in time are estimated together
with the parameters (`weighted_least_squares`). The runs stay what they are: least squares, from which it begins.
"""

from collections.abc import Sequence

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.optimize.contract import RunResult
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.problem.correlated.least_squares import weighted_least_squares
from plantfit.problem.correlated.limits import MOST, by_chance, enough
from plantfit.problem.correlated.weighted_answer import SURE, Weighted
from plantfit.problem.problem import GENERALISED, Problem
from plantfit.study.comparing.basins import basins
from plantfit.trust.finish.final_problem import REFUSED, rounding
from plantfit.trust.finish.unknown_noise import unknown_noise
from plantfit.trust.intervals.linearised import Local, linearise
from plantfit.trust.intervals.ranges import Range, linear_range
from plantfit.trust.intervals.robust_or_classical import timed

# p-value of Hausman's test below which errors that are stated to be shared are no longer all; it is below 1 % in 6 % of
# the records of a right model (the robot's motor), and in these least squares is off
SHARED = 1e-4
SAME = 1e-6  # relative difference of costs that counts as the same


def with_noise_weights(problem: Problem, runs: Sequence[RunResult]) -> Problem:
    """The final problem of these runs with `Problem.weighted`, or with a sentence why not where the study asks for it
    in words; as it is where nothing asks for it."""
    if not problem.generalised:
        return problem
    found = _weighted(problem, runs)
    if isinstance(found, Weighted):
        return problem.with_answer(found)
    return problem.with_answer(None, found) if problem.estimator == GENERALISED else problem


def unweighable(problem: Problem) -> str | None:
    """Why no weights are looked for, as a clause: None for samples in time, of known noise and not too many."""
    if not (problem.in_time or timed(problem)):
        return "rows without times may stand in any order, so that neighbours tell nothing of each other"
    if silent := unknown_noise(problem):
        return f"nothing shows how large the errors of {silent[0]} are"
    samples, d = sum(problem.parts.counts.values()), problem.space.dimension
    return f"{samples} samples and {d} parameters would take too long" if samples * d > MOST else None


def weighted_ranges(problem: Problem, weighted: Weighted | Filtered) -> dict[int, Range]:
    """The 95 % interval of every coordinate by its place."""
    ends = [weighted.interval[n] for n in problem.space.names]
    return {i: Range(-np.inf if a is None else a, np.inf if b is None else b) for i, (a, b) in enumerate(ends)}


def no_beginning(problem: Problem, runs: Sequence[RunResult]) -> str | None:
    """Why least squares gives no answer that another estimator could begin at, as a clause: none that can be
    followed, several, or a parameter that is left open."""
    best = min(runs, key=lambda r: r.cost)
    return _not_one(problem, runs) or _open(problem, linearise(problem, best.x))


def _weighted(problem: Problem, runs: Sequence[RunResult]) -> Weighted | str:
    """The answer, or what stands against it."""
    return _not_one(problem, runs) or weights_at(problem, min(runs, key=lambda r: r.cost).x)


def _not_one(problem: Problem, runs: Sequence[RunResult]) -> str | None:
    best = min(runs, key=lambda r: r.cost)
    if not np.isfinite(best.cost) or best.extra.get("ended") == REFUSED:
        return "no run has an answer that can be followed"
    near = [r for r in runs if r.cost <= best.cost * (1.0 + SAME) + rounding(problem)]
    if len(basins(np.array([r.cost for r in near]), np.array([r.x for r in near]), SAME, rounding(problem))) > 1:
        return "several answers have the same cost"
    return None


def weights_at(problem: Problem, z: np.ndarray) -> Weighted | str:
    """The answer of generalised least squares from that of least squares at the cube point z (d,), or a clause that
    says what stands against it."""
    if why := unweighable(problem) or _open(problem, linearise(problem, z)):
        return why
    values = dict(zip(problem.space.names, np.asarray(problem.space.physical(z)).tolist(), strict=True))
    try:
        found = weighted_least_squares(problem, values)
    except SearchError as error:
        return str(error).removesuffix(".")
    return _objection(found) or found


def _open(problem: Problem, local: Local) -> str | None:
    """Which parameter has no interval with two ends at the answer of least squares, as a clause."""
    if local.linear is None:
        return "tables and more than 60 parameters have least squares alone"
    for i, name in enumerate(problem.space.names):
        found = linear_range(local.linear, i)
        if local.at_bound[i] or not (np.isfinite(found.low) and np.isfinite(found.high)):
            return f"{name} is not determined"
    return None


def _objection(found: Weighted) -> str | None:
    """Why the weighted answer is not taken."""
    shared = any(n.noise.form for n in found.noises)
    if found.difference is not None and found.difference.p < (SHARED if shared else SURE):
        return "not all that is left is noise"
    for n in found.noises:
        if not enough(n.noise.degrees, n.samples):
            return (
                f"the {n.samples} residuals of {n.output} are worth {n.noise.degrees:.0f} independent ones, too few to "
                "tell noise from what the model lacks"
            )
        if not by_chance(n.left, n.samples):
            return f"the residuals of {n.output} stay correlated"
    if not any(n.noise.order or n.noise.form for n in found.noises):
        return "the residuals are white, so that it is least squares"
    loose = [name for name, ends in found.interval.items() if None in ends]
    return f"{loose[0]} is not determined" if loose else None


__all__ = ["no_beginning", "unweighable", "weighted_ranges", "weights_at", "with_noise_weights"]
