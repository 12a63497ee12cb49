"""Looks at the recordings of a problem: at signals and clock, and at what the bounds of its parameters expect of
them."""

from plantfit.trust.looks.against_model import not_followed, problem_looks

__all__ = ["not_followed", "problem_looks"]
