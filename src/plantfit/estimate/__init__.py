"""Parameters from regressions whose columns are themselves measured with errors, and what two estimates say of each other."""

from plantfit.estimate.comparison import Comparison, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.instrumental import instrumental_variables
from plantfit.estimate.inverse_dynamics import InverseDynamics, InverseFit
from plantfit.estimate.parallel_filter import ParallelFilter

__all__ = [
    "Comparison",
    "Estimate",
    "InverseDynamics",
    "InverseFit",
    "ParallelFilter",
    "compare_estimates",
    "instrumental_variables",
]
