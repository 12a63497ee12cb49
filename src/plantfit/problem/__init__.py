"""Problems: recordings + model + space as pure functions."""

from plantfit.problem.experiment import Experiment, split
from plantfit.problem.problem import Problem
from plantfit.problem.shooting import Shooting, Shot, shooting_start
from plantfit.problem.verification import Verified, verify

__all__ = ["Experiment", "Problem", "Shooting", "Shot", "Verified", "shooting_start", "split", "verify"]
