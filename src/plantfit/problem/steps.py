"""How finely to simulate: step doubling before the fit, at random points of the box and at the answer."""

from collections.abc import Callable

import numpy as np
from scipy.stats import qmc

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.simulate.steppers import ORDER

COARSE = 0.003  # step error before the fit, as a share of the spread of the measured output
SLOPE = 0.01  # error of the slope by dead times before the fit, as a share of that slope
FINE = 0.03  # step error at the answer, as a share of the residual
FINEST = 64
OFTEN = 0.1  # jumps a sample from which on the slope by a dead time is looked at
DELAY_SHARE = 1e-5  # of its range, by which a dead time is moved to see a slope


def choose_substeps(problem: Problem, points: int = 16) -> Problem:
    """The problem with the fewest substeps (1, 2, 4 .. 64) whose step error is small over most of the box.

    At the points of a fixed Sobol sequence the median of rms(step error) / std(output) has to fall
    under 0.3 %; points that cannot be simulated are left out. Where a late input is held and jumps often, the error of the slope
    by its dead time has to fall under 1 % too, or the steps are a quarter: steps are cut at the jumps, and the slope is uneven
    where these cross samples. Nothing is done when the user has chosen.
    """
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return problem
    z = qmc.Sobol(problem.space.dimension, scramble=True, rng=0).random(points)
    problem = _refined_until(problem, _step_error, z, COARSE, FINEST)
    on_samples = _delays_on_samples(problem, z[: len(z) // 2])
    if on_samples is None:
        return problem
    return _refined_until(problem, _slope_error, on_samples, SLOPE, min(4 * problem.predictor.stepping().substeps, FINEST))


def _refined_until(problem: Problem, error: Callable[[Problem, np.ndarray], float], z: np.ndarray, small: float, most: int) -> Problem:
    """The problem with steps halved until the median of `error` over the rows of z is below `small`, or there are `most` substeps."""
    while problem.predictor.stepping().substeps < most:
        shares = [s for s in (error(problem, row) for row in z) if np.isfinite(s)]
        if shares and np.median(shares) < small:
            break
        problem = problem.with_simulator(problem.predictor.stepping().refined(2))
    return problem


def refined_at(problem: Problem, z: np.ndarray) -> Problem:
    """The problem with steps halved until their error at the cube point z is under 3 % of the residual."""
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return problem
    rms = float(np.sqrt(np.mean(np.asarray(problem.residuals(z)) ** 2)))
    while problem.predictor.stepping().substeps < FINEST and _scaled_error(problem, z) > FINE * rms:
        problem = problem.with_simulator(problem.predictor.stepping().refined(2))
    return problem


def _scaled_error(problem: Problem, z: np.ndarray) -> float:
    """Estimated rms of the step error in scaled residuals."""
    return float(np.sqrt(np.mean(step_errors(problem, z) ** 2)))


def _step_error(problem: Problem, z: np.ndarray) -> float:
    spread = [
        np.full(len(y), max(float(np.std(y)), 1e-300) / problem.scales[output])
        for name in problem.data["drive"]
        for output in problem.outputs
        if len(y := problem.data["measured"][name][output])
    ]
    return float(np.sqrt(np.mean((step_errors(problem, z) / np.concatenate(spread)) ** 2)))


def step_errors(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Estimated step error of every scaled residual (m,) at a cube point: residuals at these steps minus those at half of them,
    times q / (q - 1) with q = 2 ** order."""
    simulator = problem.predictor.stepping()
    q = 2.0 ** ORDER[simulator.stepper]
    fine = problem.with_simulator(simulator.refined(2))
    return np.asarray(problem.residuals(z) - fine.residuals(z)) * q / (q - 1.0)


def _jumping_delays(problem: Problem) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Free dead times of held inputs that jump often: by coordinate, the samples and jumps (s) of a recording that it enters."""
    simulator, found = problem.predictor.stepping(), {}
    for channel, delay in enumerate(simulator.vector.model.delays):
        root = problem.space.root(delay.parameter)
        for i, c in enumerate(problem.space.coordinates):
            if c.parameter != root or delay.input in simulator.interpolated:
                continue
            drive = problem.data["drive"][c.recording or next(iter(problem.data["drive"]))]
            t, jumps = np.asarray(drive.t), np.asarray(drive.delayed[channel].knots)
            if len(jumps) > OFTEN * len(t):
                found[i] = t, jumps
    return found


def _delays_on_samples(problem: Problem, z: np.ndarray) -> np.ndarray | None:
    """The cube points z with `_jumping_delays` moved, so that jumps fall on samples; None if there are none."""
    values, delays = np.array(problem.space.physical(z)), _jumping_delays(problem)
    for i, (t, jumps) in delays.items():
        c = problem.space.coordinates[i]
        inside = (t - jumps[0])[(t - jumps[0] > c.lower) & (t - jumps[0] < c.upper)]
        if len(inside):
            values[:, i] = inside[np.argmin(np.abs(values[:, i, None] - inside), axis=1)]
    return problem.space.cube(values) if delays else None


def _slope_error(problem: Problem, z: np.ndarray) -> float:
    """Step error of the residuals' slope by `_jumping_delays` together at a cube point, from the worse side, as a share of the slope."""
    places, values = list(_jumping_delays(problem)), np.array(problem.space.physical(z))
    width = DELAY_SHARE * (problem.space.upper - problem.space.lower)[places]
    simulator = problem.predictor.stepping()
    q = 2.0 ** ORDER[simulator.stepper]
    fine = problem.with_simulator(simulator.refined(2))

    def slope(steps: Problem, side: float) -> np.ndarray:
        moved = values.copy()
        moved[places] += side * width
        return side * (np.asarray(steps.residuals(problem.space.cube(moved))) - np.asarray(steps.residuals(z)))

    shares = []
    for side in (1.0, -1.0):
        exact = slope(fine, side)
        shares.append(np.sqrt(np.mean((slope(problem, side) - exact) ** 2)) * q / (q - 1.0) / max(np.sqrt(np.mean(exact**2)), 1e-300))
    return float(np.max(shares))
