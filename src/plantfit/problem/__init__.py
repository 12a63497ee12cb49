"""Problems: recordings + model + space as pure functions."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.problem.accuracy.verification import CheckedCost, Verified, checked_cost, verify
    from plantfit.problem.evaluate.projection import Projection
    from plantfit.problem.measure.experiment import Experiment, split
    from plantfit.problem.problem import Problem
    from plantfit.problem.shooting.start import Shooting, Shot, shooting_start

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
        "measure.experiment": "Experiment split",
        "problem": "Problem",
        "evaluate.projection": "Projection",
        "shooting.start": "Shooting Shot shooting_start",
        "accuracy.verification": "CheckedCost Verified checked_cost verify",
    },
)
