"""How large the error of steps is at a point: step doubling, in scaled residuals and as a share of the spread of the
outputs."""

from functools import lru_cache

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.accuracy.mesh import effects
from plantfit.problem.evaluate.points import residuals, residuals_alone
from plantfit.problem.problem import Problem
from plantfit.simulate.steps.registry import STEPPERS

FINE = 0.03  # step error at the answer, as a share of the residual
FINE_EACH = 0.05  # the same in each recording by itself; the verdict calls more not negligible
# of the level of an output that never moves: what counts as its spread, and what is rounding of it
STILL, ROUNDED = (1e-3, 1e-9)
LEAST = 1e-6  # step error that is asked for at most, as a share of the spread of the measured outputs


def step_errors(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Estimated step error of every scaled residual (m,) at a cube point: residuals at these steps minus those at
    half of them, times q / (q - 1) with q = 2 ** order."""
    simulator = problem.predictor.stepping()
    q = 2.0 ** STEPPERS[simulator.stepper].order
    fine = halved(problem)
    return (residuals_at(problem, z) - residuals_alone(fine, z)) * q / (q - 1.0)


def scaled_error(problem: Problem, z: np.ndarray) -> float:
    """Estimated rms of the step error in scaled residuals."""
    return float(np.sqrt(np.mean(step_errors(problem, z) ** 2)))


def step_error(problem: Problem, z: np.ndarray) -> float:
    """Estimated rms of the step error at a cube point (d,), as a share of the spread of each output."""
    with np.errstate(over="ignore"):  # a candidate that explodes is that far off
        return float(np.sqrt(np.mean(_shares(problem, z) ** 2)))


def largest_step_error(problem: Problem, z: np.ndarray) -> float:
    """Estimated largest step error of a sample at a cube point (d,), as a share of the spread of its output."""
    return float(np.max(np.abs(_shares(problem, z))))


def _shares(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Step errors (m,) as shares of the spread of each output."""
    spread = [
        np.full(len(y), _spread(y, problem.scales[output]) / problem.scales[output])
        for name in problem.data["drive"]
        for output in problem.outputs
        if len(y := problem.data["measured"][name][output])
    ]
    return step_errors(problem, z) / np.concatenate(spread)


def largest_error(problem: Problem, z: np.ndarray, spreads: dict[str, float]) -> float:
    """The largest step error of a measured sample, as a share of the spread of its output."""
    found = [effects(problem, z[None, :], name, spreads)[0].error for name in problem.whole_drives]
    return float(np.max(np.abs(np.concatenate(found)), initial=0.0))


def all_spreads(problem: Problem) -> dict[str, float]:
    """The spread of each measured output over all recordings, in its unit."""
    return {o: _spread(np.concatenate(_measured(problem, o)), problem.scales[o]) for o in problem.outputs}


def _spread(y: np.ndarray, scale: float) -> float:
    """The standard deviation of a measured output; of one that never moves a thousandth of its level, or its scale
    where that is zero."""
    level = float(np.max(np.abs(y), initial=0.0))
    return next((v for v in (float(np.std(y)) if len(y) else 0.0, STILL * level) if v > ROUNDED * level), scale)


def _measured(problem: Problem, output: str) -> list[np.ndarray]:
    return [own[output] for own in problem.data["measured"].values()]


def least(problem: Problem) -> float:
    """A step error that is small enough whatever the residuals are (rms of scaled outputs)."""
    spreads = [
        (_spread(y, problem.scales[o]) / problem.scales[o]) ** 2
        for o in problem.outputs
        for y in _measured(problem, o)
        if len(y)
    ]
    return LEAST * float(np.sqrt(np.mean(spreads)))


def small_at(problem: Problem, z: np.ndarray) -> float:
    """The step error (rms of scaled outputs) that is small beside the residual at a cube point (d,)."""
    return max(FINE * float(np.sqrt(np.mean(residuals(problem, z) ** 2))), least(problem))


def uneven(problem: Problem, z: np.ndarray) -> bool:
    """Whether the steps are not fine enough in one of several recordings."""
    if len(problem.data["drive"]) < 2:
        return False
    errors, all_residuals, start = step_errors(problem, z), residuals_at(problem, z), 0
    for name in problem.data["drive"]:
        count = sum(len(problem.data["index"][name][o]) for o in problem.outputs)
        error, residual = (float(np.sum(v[start : start + count] ** 2)) ** 0.5 for v in (errors, all_residuals))
        if error > max(FINE_EACH * residual, least(problem) * count**0.5):
            return True
        start += count
    return False


@lru_cache(maxsize=1)  # asked for at one point after the other, and its numbers are put on the device once
def halved(problem: Problem) -> Problem:
    """The problem with steps of half the length."""
    return problem.with_simulator(problem.predictor.stepping().refined(2))


def residuals_at(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Residuals (m,): with whole steps by what a search with them compiles anyway, of finer ones as they were
    compared before."""
    return residuals(problem, z) if problem.predictor.stepping().substeps == 1 else residuals_alone(problem, z)
