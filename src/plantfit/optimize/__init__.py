"""Search on the unit cube: the contract, the methods by name, and the one loop."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.optimize.contract import Facts, Host, Needs, Objective, Population, Refreshing, RunResult, Shrinking
    from plantfit.optimize.loop.checkpoint import Checkpoint
    from plantfit.optimize.loop.counter import Counter
    from plantfit.optimize.loop.entry import minimise
    from plantfit.optimize.loop.progress import Progress
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

names_of(
    __name__,
    {
        "loop.checkpoint": "Checkpoint",
        "contract": "Facts Host Needs Objective Population Refreshing RunResult Shrinking",
        "loop.counter": "Counter",
        "loop.entry": "minimise",
        "loop.progress": "Progress",
        "registry": "make methods",
    },
)
