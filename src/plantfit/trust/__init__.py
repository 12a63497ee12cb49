"""What an answer is worth: errors, identifiability, residual tests, verdict."""

from plantfit.trust.assess import assess
from plantfit.trust.base_parameters import BaseParameters, base_parameters
from plantfit.trust.combinations import Combinations, combinations
from plantfit.trust.covariance import covariance
from plantfit.trust.directions import Direction, flat_directions
from plantfit.trust.flat_curves import FlatCurve, flat_curves
from plantfit.trust.local import Local, linearise
from plantfit.trust.residual_tests import autocorrelation, cross_correlation, whiteness

__all__ = [
    "BaseParameters",
    "Combinations",
    "Direction",
    "FlatCurve",
    "Local",
    "assess",
    "autocorrelation",
    "base_parameters",
    "combinations",
    "covariance",
    "cross_correlation",
    "flat_curves",
    "flat_directions",
    "linearise",
    "whiteness",
]
