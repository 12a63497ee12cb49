"""Beside the paper's study, in a process of its own too: what the record determines, unbiased estimates, a controller
on them, and the next experiment."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.cases.pendubot.cross_check import forward_fit, inverse_fit
from plantfit.cases.pendubot.sections.control_section import control_section
from plantfit.cases.pendubot.sections.cross_check_section import cross_check_section
from plantfit.cases.pendubot.sections.experiment_section import experiment_section
from plantfit.cases.pendubot.sections.identifiability_section import identifiability_section
from plantfit.cases.pendubot.torque import torque_record
from plantfit.cases.shared.stages import stages
from plantfit.estimate import InverseFit
from plantfit.models.library.pendubot_terms import base_values
from plantfit.recording import cut
from plantfit.rig import PendubotRig

SEED = 7  # a record of its own, not that of the paper's study
STRETCH = (4.5, 9.5)  # s, with the first move, for the forward fit of the small demo
PARTS = ("instrumental variables", "forward fit", "what the record determines", "controllers")


@dataclass(frozen=True)
class BetterStudy:
    """Sections of the page, and what they found."""

    sections: list[dict[str, Any]]
    found: list[str]


def better_study(full: bool, progress: Callable[[Any], None] | None = None) -> BetterStudy:
    """All but the next experiment; `full` fits the whole record forward."""
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
    sections = [told, cross_check_section(inverse, forward, truth, stretch=None if full else STRETCH), held]
    return BetterStudy(sections, [_unbiased(inverse, truth), _caught(held)])


def next_experiment(full: bool) -> dict[str, Any]:
    """The section of the next experiment; `full` looks longer for it."""
    return experiment_section(PendubotRig(), budget=2400 if full else 200, seed=SEED, records=10 if full else 1)


def _unbiased(inverse: InverseFit, truth: Mapping[str, float]) -> str:
    true = np.array([truth[n] for n in inverse.estimate.names])
    plain = {
        n: 100 * (v / truth[n] - 1)
        for n, v in zip(inverse.least_squares.names, inverse.least_squares.values, strict=True)
    }
    worst = max(plain, key=lambda n: abs(plain[n]))
    far = float(np.max(np.abs((inverse.estimate.values - true) / inverse.estimate.standard_error)))
    return (
        f"Plain least squares of the torque has {worst} off by {plain[worst]:+.0f} %, because "
        "its columns are differentiated encoder steps; instrumental variables have all of "
        f"{', '.join(inverse.estimate.names)} within {far:.1f} standard errors of the truth."
    )


def _caught(held: Mapping[str, Any]) -> str:
    """By the table of the controllers: the leans that each catches to the worse side."""
    leans = {row[0]: min(float(row[2]), float(row[3])) for row in held["tables"][0]["rows"]}
    said = ", ".join(f"{n} {v:.1f}" for n, v in sorted(leans.items(), key=lambda p: -p[1]))
    return (
        "Designed on the identified plant and tried on the true one, "
        f"controllers catch leans of link 1 of so many degrees: {said}."
    )
