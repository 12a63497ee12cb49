"""Controllers, their design on a linearised model, and what they are judged by."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.control.c_export import CFiles, design_to_c, kalman_to_c, pid_to_c
    from plantfit.control.catching import Caught, largest_initial_angle
    from plantfit.control.dead_time import with_dead_time
    from plantfit.control.design import Design
    from plantfit.control.kalman import Estimator, kalman_observer
    from plantfit.control.linear_plant import LinearPlant, discretised, equilibrium, linearised
    from plantfit.control.lqr import lqr
    from plantfit.control.mpc import mpc
    from plantfit.control.offset_free import offset_free_mpc
    from plantfit.control.pid import Gains, pid
    from plantfit.control.pid_per_output import pid_per_output
    from plantfit.control.robust import Demand, Tuned, costs_over, judged, robust_tuning, stacked_controllers
    from plantfit.control.step_metrics import StepMetrics, step_metrics, step_observer
    from plantfit.control.step_profile import StepProfile, StepScores, profile_scores
    from plantfit.control.takagi_sugeno import takagi_sugeno

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
        "dead_time": "with_dead_time",
        "design": "Design",
        "kalman": "Estimator kalman_observer",
        "linear_plant": "LinearPlant discretised equilibrium linearised",
        "lqr": "lqr",
        "mpc": "mpc",
        "offset_free": "offset_free_mpc",
        "pid": "Gains pid",
        "pid_per_output": "pid_per_output",
        "robust": "Demand Tuned costs_over judged robust_tuning stacked_controllers",
        "step_metrics": "StepMetrics step_metrics step_observer",
        "step_profile": "StepProfile StepScores profile_scores",
        "takagi_sugeno": "takagi_sugeno",
    },
)
