"""Levels of the staircase: every second one fitted, the others predicted; and a model of its own for each."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from plantfit.fitting import Answer, fit
from plantfit.models import equations
from plantfit.problem import Experiment, Problem
from plantfit.recording import subtract
from plantfit.recording.clean.levels import levels
from plantfit.recording.record import Recording
from plantfit.space import Parameter
from plantfit.spec import parse

_REFITTED = """
T' = (rest + K*delay(u, L) - T)/tau
y = T
"""


def between_levels(file: Path) -> Answer:
    """The model of `file` with nodes at every second level, fitted to those, begun anew at the first sample of each
    level."""
    study = parse(file.read_text("utf-8").replace("count = 13", "count = 7"), file)
    record = study.problem.experiments["january"].recording
    pieces = levels(record, "u")
    experiments = {}
    for k, piece in enumerate(pieces):
        everything, fitted = (-np.inf, np.inf), k % 2 == 0
        before = {"u": float(pieces[max(0, k - 1)]["u"][0])}
        experiments[piece.name] = Experiment(
            piece, everything if fitted else None, None if fitted else everything, before=before
        )
    problem = Problem(study.problem.model, experiments, study.problem.space.parameters, name="every second level")
    plan = study.plan
    return fit(problem, budget=plan.budget, seed=plan.seed, settings=plan.settings["auto"])


def refitted(record: Recording) -> Answer:
    """First order with dead time for each step of `record` by itself: K, tau, L and where it rests before, named
    K[january_2], ..."""
    pieces = levels(record, "u")
    experiments = {}
    for old, new in pairwise(pieces):
        moved = subtract(new, "u", float(old["u"][0]))
        experiments[new.name] = Experiment(replace(moved, name=new.name), before={"u": 0.0})
    model = equations(
        _REFITTED,
        inputs={"u": "1"},
        states={"T": {"unit": "degC", "initial": "rest"}},
        outputs={"y": "degC"},
        parameters={"K": "degC", "tau": "s", "L": "s", "rest": "degC"},
    )
    bounds = {"K": (-100, 100), "tau": (2, 800), "L": (0, 100), "rest": (20, 80)}
    parameters = {
        n: Parameter(b, scale="log" if n == "tau" else "linear", per_recording=True) for n, b in bounds.items()
    }
    return fit(Problem(model, experiments, parameters, name="a model for each level"), seed=1)
