"""What an answer is worth: errors, identifiability, residual tests, verdict."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.trust.assess import assess
    from plantfit.trust.experiment.d_optimal import Experiment, Gain, d_optimal, gain
    from plantfit.trust.identify.added_measurements import Measurement, Openings, openings
    from plantfit.trust.identify.base_parameters import BaseParameters, base_parameters
    from plantfit.trust.identify.before_fit import BeforeFit, before_fit
    from plantfit.trust.identify.combinations import Combinations, combinations
    from plantfit.trust.identify.directions import Direction, flat_directions
    from plantfit.trust.identify.flat_curves import FlatCurve, flat_curves
    from plantfit.trust.identify.open_answers import open_answers
    from plantfit.trust.intervals.covariance import covariance
    from plantfit.trust.intervals.linearised import Local, linearise
    from plantfit.trust.intervals.profile import Profile, profile
    from plantfit.trust.intervals.regression_errors import RegressionPart, regression_covariance
    from plantfit.trust.rigid_body.certified_floor import Floor, certified_floor
    from plantfit.trust.rigid_body.constrained_optimum import Optimum, constrained_optimum
    from plantfit.trust.rigid_body.feasibility import LinkNames, link_constraints
    from plantfit.trust.rigid_body.real_bodies import Possible, nearest_possible
    from plantfit.trust.sensitivity.salib_extra import has_salib, need_salib
    from plantfit.trust.sensitivity.screening import Screening, morris
    from plantfit.trust.sensitivity.sobol_indices import SobolIndices, sobol_indices
    from plantfit.trust.stated_errors.parameter_uncertainty import (
        ParameterUncertainty,
        SharedError,
        propagate,
        propagate_by_monte_carlo,
    )
    from plantfit.trust.stated_errors.reading_budgets import reading_budgets
    from plantfit.trust.stated_errors.uncertainty_budget import Budget, Source, type_a, type_b, uncertainty_budget
    from plantfit.trust.validate.dead_time import DeadTime, dead_time
    from plantfit.trust.validate.residuals.residual_tests import autocorrelation, cross_correlation, whiteness

__all__ = [
    "BaseParameters",
    "BeforeFit",
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
    "before_fit",
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
        "identify.base_parameters": "BaseParameters base_parameters",
        "rigid_body.certified_floor": "Floor certified_floor",
        "identify.combinations": "Combinations combinations",
        "rigid_body.constrained_optimum": "Optimum constrained_optimum",
        "intervals.covariance": "covariance",
        "validate.dead_time": "DeadTime dead_time",
        "identify.directions": "Direction flat_directions",
        "rigid_body.feasibility": "LinkNames link_constraints",
        "identify.before_fit": "BeforeFit before_fit",
        "identify.flat_curves": "FlatCurve flat_curves",
        "intervals.linearised": "Local linearise",
        "experiment.d_optimal": "Experiment Gain d_optimal gain",
        "identify.open_answers": "open_answers",
        "identify.added_measurements": "Measurement Openings openings",
        "stated_errors.parameter_uncertainty": "ParameterUncertainty SharedError propagate propagate_by_monte_carlo",
        "rigid_body.real_bodies": "Possible nearest_possible",
        "intervals.profile": "Profile profile",
        "stated_errors.reading_budgets": "reading_budgets",
        "intervals.regression_errors": "RegressionPart regression_covariance",
        "validate.residuals.residual_tests": "autocorrelation cross_correlation whiteness",
        "sensitivity.salib_extra": "has_salib need_salib",
        "sensitivity.screening": "Screening morris",
        "sensitivity.sobol_indices": "SobolIndices sobol_indices",
        "stated_errors.uncertainty_budget": "Budget Source type_a type_b uncertainty_budget",
    },
)
