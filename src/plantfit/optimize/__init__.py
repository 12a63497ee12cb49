"""Search on the unit cube: the contract, the methods by name, and the one loop."""

from plantfit.optimize.checkpoint import Checkpoint
from plantfit.optimize.contract import Facts, Host, Needs, Objective, Population, Refreshing, RunResult, Shrinking
from plantfit.optimize.counter import Counter
from plantfit.optimize.loop import minimise
from plantfit.optimize.progress import Progress
from plantfit.optimize.registry import make, methods

__all__ = [
    "Checkpoint",
    "Counter",
    "Facts",
    "Host",
    "Needs",
    "Objective",
    "Population",
    "Progress",
    "Refreshing",
    "RunResult",
    "Shrinking",
    "make",
    "methods",
    "minimise",
]
