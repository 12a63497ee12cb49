"""Controllers, their design on a linearised model, and what they are judged by."""

from plantfit.control.catching import Caught, largest_initial_angle
from plantfit.control.design import Design
from plantfit.control.kalman import Estimator, kalman_observer
from plantfit.control.linear_plant import LinearPlant, discretised, equilibrium, linearised
from plantfit.control.lqr import lqr
from plantfit.control.mpc import mpc
from plantfit.control.pid import Gains, pid
from plantfit.control.pid_per_output import pid_per_output
from plantfit.control.step_metrics import StepMetrics, step_metrics, step_observer
from plantfit.control.takagi_sugeno import takagi_sugeno

__all__ = [
    "Caught",
    "Design",
    "Estimator",
    "Gains",
    "LinearPlant",
    "StepMetrics",
    "discretised",
    "equilibrium",
    "kalman_observer",
    "largest_initial_angle",
    "linearised",
    "lqr",
    "mpc",
    "pid",
    "pid_per_output",
    "step_metrics",
    "step_observer",
    "takagi_sugeno",
]
