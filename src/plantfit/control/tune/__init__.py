"""Controllers of one loop tuned on every plant that the data allow, beside the classical rules."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.control.tune.frequency import Margins, margins, pid_response, sampled_response
    from plantfit.control.tune.one_loop import OneLoop, Rest
    from plantfit.control.tune.pid_design import PidDesign, Wishes, tuned_pid
    from plantfit.control.tune.reduction import Reduced, reduced
    from plantfit.control.tune.rules import RULES, Isa, rule_gains

__all__ = [
    "RULES",
    "Isa",
    "Margins",
    "OneLoop",
    "PidDesign",
    "Reduced",
    "Rest",
    "Wishes",
    "margins",
    "pid_response",
    "reduced",
    "rule_gains",
    "sampled_response",
    "tuned_pid",
]

names_of(
    __name__,
    {
        "frequency": "Margins margins pid_response sampled_response",
        "one_loop": "OneLoop Rest",
        "pid_design": "PidDesign Wishes tuned_pid",
        "reduction": "Reduced reduced",
        "rules": "RULES Isa rule_gains",
    },
)
