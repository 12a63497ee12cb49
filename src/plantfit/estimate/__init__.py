"""Parameters from regressions whose columns are themselves measured with errors, and what two estimates say of each other."""

from plantfit.estimate.comparison import Comparison, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.forward import estimate_at, free_start, windows
from plantfit.estimate.instrumental import instrumental_variables
from plantfit.estimate.inverse_dynamics import InverseDynamics, InverseFit

__all__ = [
    "Comparison",
    "Estimate",
    "InverseDynamics",
    "InverseFit",
    "compare_estimates",
    "estimate_at",
    "free_start",
    "instrumental_variables",
    "windows",
]
