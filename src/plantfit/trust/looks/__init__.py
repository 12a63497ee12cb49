"""Looks at the recordings of a problem: at signals and clock, and at what the bounds of its parameters expect of
them."""

from plantfit.trust.looks.against_model import problem_looks

__all__ = ["problem_looks"]
