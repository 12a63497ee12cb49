"""Problems: recordings + model + space as pure functions."""

from plantfit.problem.experiment import Experiment, split
from plantfit.problem.problem import Problem

__all__ = ["Experiment", "Problem", "split"]
