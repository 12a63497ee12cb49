"""Controllers of one loop tuned on every plant that the data allow, beside the classical rules."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.control.tune.frequency import Margins, margins, pid_response, sampled_response
    from plantfit.control.tune.loop_design import LoopDesign, tuned_loop
    from plantfit.control.tune.one_loop import OneLoop, Rest
    from plantfit.control.tune.reduction import Reduced, reduced
    from plantfit.control.tune.rules import RULES, Isa, rule_gains
    from plantfit.control.tune.wishes import Wishes

__all__ = [
    "RULES",
    "Isa",
    "LoopDesign",
    "Margins",
    "OneLoop",
    "Reduced",
    "Rest",
    "Wishes",
    "margins",
    "pid_response",
    "reduced",
    "rule_gains",
    "sampled_response",
    "tuned_loop",
]

names_of(
    __name__,
    {
        "frequency": "Margins margins pid_response sampled_response",
        "one_loop": "OneLoop Rest",
        "loop_design": "LoopDesign tuned_loop",
        "reduction": "Reduced reduced",
        "rules": "RULES Isa rule_gains",
        "wishes": "Wishes",
    },
)
