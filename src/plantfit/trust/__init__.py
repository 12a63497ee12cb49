"""What an answer is worth: errors, identifiability, residual tests, verdict."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.trust.assess import assess
    from plantfit.trust.base_parameters import BaseParameters, base_parameters
    from plantfit.trust.certified_floor import Floor, certified_floor
    from plantfit.trust.combinations import Combinations, combinations
    from plantfit.trust.constrained_optimum import Optimum, constrained_optimum
    from plantfit.trust.covariance import covariance
    from plantfit.trust.dead_time import DeadTime, dead_time
    from plantfit.trust.directions import Direction, flat_directions
    from plantfit.trust.feasibility import LinkNames, link_constraints
    from plantfit.trust.flat_curves import FlatCurve, flat_curves
    from plantfit.trust.local import Local, linearise
    from plantfit.trust.next_experiment import Experiment, Gain, d_optimal, gain
    from plantfit.trust.open_answers import open_answers
    from plantfit.trust.openings import Measurement, Openings, openings
    from plantfit.trust.parameter_uncertainty import ParameterUncertainty, SharedError, propagate, propagate_by_monte_carlo
    from plantfit.trust.possible import Possible, nearest_possible
    from plantfit.trust.profile import Profile, profile
    from plantfit.trust.reading_budgets import reading_budgets
    from plantfit.trust.regression_errors import RegressionPart, regression_covariance
    from plantfit.trust.residual_tests import autocorrelation, cross_correlation, whiteness
    from plantfit.trust.salib_extra import has_salib, need_salib
    from plantfit.trust.screening import Screening, morris
    from plantfit.trust.sobol_indices import SobolIndices, sobol_indices
    from plantfit.trust.uncertainty_budget import Budget, Source, type_a, type_b, uncertainty_budget

__all__ = [
    "BaseParameters",
    "Budget",
    "Combinations",
    "DeadTime",
    "Direction",
    "Experiment",
    "FlatCurve",
    "Floor",
    "Gain",
    "LinkNames",
    "Local",
    "Measurement",
    "Openings",
    "Optimum",
    "ParameterUncertainty",
    "Possible",
    "Profile",
    "RegressionPart",
    "Screening",
    "SharedError",
    "SobolIndices",
    "Source",
    "assess",
    "autocorrelation",
    "base_parameters",
    "certified_floor",
    "combinations",
    "constrained_optimum",
    "covariance",
    "cross_correlation",
    "d_optimal",
    "dead_time",
    "flat_curves",
    "flat_directions",
    "gain",
    "has_salib",
    "linearise",
    "link_constraints",
    "morris",
    "nearest_possible",
    "need_salib",
    "open_answers",
    "openings",
    "profile",
    "propagate",
    "propagate_by_monte_carlo",
    "reading_budgets",
    "regression_covariance",
    "sobol_indices",
    "type_a",
    "type_b",
    "uncertainty_budget",
    "whiteness",
]

names_of(
    __name__,
    {
        "assess": "assess",
        "base_parameters": "BaseParameters base_parameters",
        "certified_floor": "Floor certified_floor",
        "combinations": "Combinations combinations",
        "constrained_optimum": "Optimum constrained_optimum",
        "covariance": "covariance",
        "dead_time": "DeadTime dead_time",
        "directions": "Direction flat_directions",
        "feasibility": "LinkNames link_constraints",
        "flat_curves": "FlatCurve flat_curves",
        "local": "Local linearise",
        "next_experiment": "Experiment Gain d_optimal gain",
        "open_answers": "open_answers",
        "openings": "Measurement Openings openings",
        "parameter_uncertainty": "ParameterUncertainty SharedError propagate propagate_by_monte_carlo",
        "possible": "Possible nearest_possible",
        "profile": "Profile profile",
        "reading_budgets": "reading_budgets",
        "regression_errors": "RegressionPart regression_covariance",
        "residual_tests": "autocorrelation cross_correlation whiteness",
        "salib_extra": "has_salib need_salib",
        "screening": "Screening morris",
        "sobol_indices": "SobolIndices sobol_indices",
        "uncertainty_budget": "Budget Source type_a type_b uncertainty_budget",
    },
)
