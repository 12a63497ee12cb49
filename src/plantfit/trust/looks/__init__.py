"""Looks at the recordings of a problem: at signals and clock, and at what the bounds of its parameters expect of
them."""

from plantfit.trust.looks.against_model import not_followed, problem_looks
from plantfit.trust.looks.unstated_hold import hold_looks

__all__ = ["hold_looks", "not_followed", "problem_looks"]
