"""What an answer is worth: errors, identifiability, residual tests, verdict."""

from plantfit.trust.assess import assess
from plantfit.trust.covariance import covariance
from plantfit.trust.directions import Direction, flat_directions
from plantfit.trust.local import Local, linearise
from plantfit.trust.residual_tests import autocorrelation, cross_correlation, whiteness

__all__ = [
    "Direction",
    "Local",
    "assess",
    "autocorrelation",
    "covariance",
    "cross_correlation",
    "flat_directions",
    "linearise",
    "whiteness",
]
