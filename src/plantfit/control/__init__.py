"""Controllers and what a step response is judged by."""

from plantfit.control.pid import Gains, pid
from plantfit.control.step_metrics import StepMetrics, step_metrics, step_observer

__all__ = ["Gains", "StepMetrics", "pid", "step_metrics", "step_observer"]
