"""Conformance suites for plug-in authors."""

from plantfit.testing.optimizers import CHECKS as OPTIMIZER_CHECKS
from plantfit.testing.optimizers import check_optimizer

__all__ = ["OPTIMIZER_CHECKS", "check_optimizer"]
