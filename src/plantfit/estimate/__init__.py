"""Parameters from regressions with errors in the regressor, states and parameters by Kalman filters, and what two estimates say."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.estimate.beliefs import Beliefs, FilterRun, Track, smoothed
    from plantfit.estimate.comparison import Comparison, compare_estimates
    from plantfit.estimate.consistency import Consistency, nees, nees_test, nis_test
    from plantfit.estimate.estimate import Estimate
    from plantfit.estimate.forward import free_start, windows
    from plantfit.estimate.instrumental import instrumental_variables
    from plantfit.estimate.inverse_dynamics import InverseDynamics, InverseFit
    from plantfit.estimate.kalman import ekf, kalman_filter, ukf
    from plantfit.estimate.maximum_likelihood import MaximumLikelihood, maximum_likelihood
    from plantfit.estimate.noise import Noise

__all__ = [
    "Beliefs",
    "Comparison",
    "Consistency",
    "Estimate",
    "FilterRun",
    "InverseDynamics",
    "InverseFit",
    "MaximumLikelihood",
    "Noise",
    "Track",
    "compare_estimates",
    "ekf",
    "free_start",
    "instrumental_variables",
    "kalman_filter",
    "maximum_likelihood",
    "nees",
    "nees_test",
    "nis_test",
    "smoothed",
    "ukf",
    "windows",
]

names_of(
    __name__,
    {
        "beliefs": "Beliefs FilterRun Track smoothed",
        "comparison": "Comparison compare_estimates",
        "consistency": "Consistency nees nees_test nis_test",
        "estimate": "Estimate",
        "forward": "free_start windows",
        "instrumental": "instrumental_variables",
        "inverse_dynamics": "InverseDynamics InverseFit",
        "kalman": "ekf kalman_filter ukf",
        "maximum_likelihood": "MaximumLikelihood maximum_likelihood",
        "noise": "Noise",
    },
)
