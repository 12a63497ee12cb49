"""Problems: recordings + model + space as pure functions."""

from plantfit.problem.experiment import Experiment, split
from plantfit.problem.problem import Problem
from plantfit.problem.projection import Projection
from plantfit.problem.shooting import Shooting, Shot, shooting_start
from plantfit.problem.verification import CheckedCost, Verified, checked_cost, verify

__all__ = [
    "CheckedCost",
    "Experiment",
    "Problem",
    "Projection",
    "Shooting",
    "Shot",
    "Verified",
    "checked_cost",
    "shooting_start",
    "split",
    "verify",
]
