"""Controllers, their design on a linearised model, and what they are judged by."""

from plantfit.control.c_export import CFiles, design_to_c, kalman_to_c, pid_to_c
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
    "CFiles",
    "Caught",
    "Design",
    "Estimator",
    "Gains",
    "LinearPlant",
    "StepMetrics",
    "design_to_c",
    "discretised",
    "equilibrium",
    "kalman_observer",
    "kalman_to_c",
    "largest_initial_angle",
    "linearised",
    "lqr",
    "mpc",
    "pid",
    "pid_per_output",
    "pid_to_c",
    "step_metrics",
    "step_observer",
    "takagi_sugeno",
]
