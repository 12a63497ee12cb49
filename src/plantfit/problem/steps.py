"""How finely to simulate: step doubling before the fit, at random points of the box and at the answer."""

import numpy as np
from scipy.stats import qmc

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem
from plantfit.simulate.steppers import ORDER

COARSE = 0.003  # step error before the fit, as a share of the spread of the measured output
FINE = 0.03  # step error at the answer, as a share of the residual
FINEST = 64


def choose_substeps(problem: Problem, points: int = 16) -> Problem:
    """The problem with the fewest substeps (1, 2, 4 .. 64) whose step error is small over most of the box.

    At the points of a fixed Sobol sequence the median of rms(step error) / std(output) has to fall
    under 0.3 %; points that cannot be simulated are left out. Nothing is done when the user has chosen.
    """
    if problem.substeps_chosen or not problem.predictor.has_steps:
        return problem
    z = qmc.Sobol(problem.space.dimension, scramble=True, rng=0).random(points)
    while problem.predictor.stepping().substeps < FINEST:
        shares = [s for s in (_step_error(problem, row) for row in z) if np.isfinite(s)]
        if shares and np.median(shares) < COARSE:
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
