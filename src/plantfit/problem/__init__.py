"""Problems: recordings + model + space as pure functions."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
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

names_of(
    __name__,
    {
        "experiment": "Experiment split",
        "problem": "Problem",
        "projection": "Projection",
        "shooting": "Shooting Shot shooting_start",
        "verification": "CheckedCost Verified checked_cost verify",
    },
)
