"""Conformance suites for plug-in authors."""

from plantfit.testing.candidates import check_candidate
from plantfit.testing.looks import check_look
from plantfit.testing.models import check_model
from plantfit.testing.optimizers import CHECKS as OPTIMIZER_CHECKS
from plantfit.testing.optimizers import check_optimizer
from plantfit.testing.readers import check_reader

__all__ = ["OPTIMIZER_CHECKS", "check_candidate", "check_look", "check_model", "check_optimizer", "check_reader"]
