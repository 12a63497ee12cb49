"""Parameters from regressions with errors in the regressor, states and parameters by Kalman filters, and what two
estimates say."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.estimate.comparison import Comparison, compare_estimates
    from plantfit.estimate.estimate import Estimate
    from plantfit.estimate.filters.beliefs import Beliefs, FilterRun, Track, smoothed
    from plantfit.estimate.filters.consistency import Consistency, nees, nees_test, nis_test
    from plantfit.estimate.filters.kalman import ekf, kalman_filter, ukf
    from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood, maximum_likelihood
    from plantfit.estimate.filters.noise import Noise
    from plantfit.estimate.instrumental import instrumental_variables
    from plantfit.estimate.inverse_dynamics import InverseDynamics, InverseFit

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
    "instrumental_variables",
    "kalman_filter",
    "maximum_likelihood",
    "nees",
    "nees_test",
    "nis_test",
    "smoothed",
    "ukf",
]

names_of(
    __name__,
    {
        "filters.beliefs": "Beliefs FilterRun Track smoothed",
        "comparison": "Comparison compare_estimates",
        "filters.consistency": "Consistency nees nees_test nis_test",
        "estimate": "Estimate",
        "instrumental": "instrumental_variables",
        "inverse_dynamics": "InverseDynamics InverseFit",
        "filters.kalman": "ekf kalman_filter ukf",
        "filters.maximum_likelihood": "MaximumLikelihood maximum_likelihood",
        "filters.noise": "Noise",
    },
)
