"""Controllers, their design on a linearised model, and what they are judged by."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.control.c_export import CFiles, design_to_c, kalman_to_c, pid_to_c
    from plantfit.control.catching import Caught, largest_initial_angle
    from plantfit.control.linear.dead_time import with_dead_time
    from plantfit.control.linear.design import Design
    from plantfit.control.linear.kalman import Estimator, kalman_observer
    from plantfit.control.linear.linear_plant import LinearPlant, discretised, equilibrium, linearised
    from plantfit.control.linear.lqr import lqr
    from plantfit.control.linear.pid_per_output import pid_per_output
    from plantfit.control.linear.predictive.mpc import mpc
    from plantfit.control.linear.predictive.offset_free import offset_free_mpc
    from plantfit.control.linear.takagi_sugeno import takagi_sugeno
    from plantfit.control.pid import Gains, pid
    from plantfit.control.steps.robust import Demand, Tuned, costs_over, judged, robust_tuning, stacked_controllers
    from plantfit.control.steps.step_metrics import StepMetrics, step_metrics, step_observer
    from plantfit.control.steps.step_profile import StepProfile, StepScores, profile_scores

__all__ = [
    "CFiles",
    "Caught",
    "Demand",
    "Design",
    "Estimator",
    "Gains",
    "LinearPlant",
    "StepMetrics",
    "StepProfile",
    "StepScores",
    "Tuned",
    "costs_over",
    "design_to_c",
    "discretised",
    "equilibrium",
    "judged",
    "kalman_observer",
    "kalman_to_c",
    "largest_initial_angle",
    "linearised",
    "lqr",
    "mpc",
    "offset_free_mpc",
    "pid",
    "pid_per_output",
    "pid_to_c",
    "profile_scores",
    "robust_tuning",
    "stacked_controllers",
    "step_metrics",
    "step_observer",
    "takagi_sugeno",
    "with_dead_time",
]

names_of(
    __name__,
    {
        "c_export": "CFiles design_to_c kalman_to_c pid_to_c",
        "catching": "Caught largest_initial_angle",
        "linear.dead_time": "with_dead_time",
        "linear.design": "Design",
        "linear.kalman": "Estimator kalman_observer",
        "linear.linear_plant": "LinearPlant discretised equilibrium linearised",
        "linear.lqr": "lqr",
        "linear.predictive.mpc": "mpc",
        "linear.predictive.offset_free": "offset_free_mpc",
        "pid": "Gains pid",
        "linear.pid_per_output": "pid_per_output",
        "steps.robust": "Demand Tuned costs_over judged robust_tuning stacked_controllers",
        "steps.step_metrics": "StepMetrics step_metrics step_observer",
        "steps.step_profile": "StepProfile StepScores profile_scores",
        "linear.takagi_sugeno": "takagi_sugeno",
    },
)
