"""Beside the paper's study: what the record determines, unbiased estimates, a controller on them, and the next experiment."""

from collections.abc import Callable
from typing import Any

from plantfit.cases.pendubot.cross_check import forward_fit, inverse_fit
from plantfit.cases.pendubot.sections.control_section import control_section
from plantfit.cases.pendubot.sections.cross_check_section import cross_check_section
from plantfit.cases.pendubot.sections.experiment_section import experiment_section
from plantfit.cases.pendubot.sections.identifiability_section import identifiability_section
from plantfit.cases.pendubot.torque import torque_record
from plantfit.cases.shared.stages import stages
from plantfit.models.library.pendubot_terms import base_values
from plantfit.recording import cut
from plantfit.rig import PendubotRig

SEED = 7  # a record of its own, not that of the paper's study
STRETCH = (4.5, 9.5)  # s, with the first move, for the forward fit of the small demo
PARTS = ("instrumental variables", "forward fit", "what the record determines", "controllers", "next experiment")


def better_study(progress: Callable[[Any], None] | None = None, full: bool = False) -> list[dict[str, Any]]:
    """Sections of the page; `full` looks longer for the next experiment."""
    begins = stages(PARTS, progress)
    rig = PendubotRig()
    made = torque_record(seed=SEED, weights=rig.weights)
    truth = base_values(made.run.truth["parameters"])
    begins("instrumental variables")
    inverse = inverse_fit(made.run.recording, rig)
    begins("forward fit")
    forward = forward_fit(made.run.recording if full else cut(made.run.recording, *STRETCH))
    begins("what the record determines")
    told = identifiability_section(made.recording, estimate=inverse.estimate, truth=truth)
    begins("controllers")
    held = control_section(inverse.estimate.named, truth)
    begins("next experiment")
    following = experiment_section(rig, budget=2400 if full else 200, seed=SEED, records=10 if full else 1)
    return [told, cross_check_section(inverse, forward, truth, stretch=None if full else STRETCH), held, following]
