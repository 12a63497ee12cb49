"""What no search of the paper's waits for, in a process of its own beside these searches: all that goes by exact
derivatives, and the static task."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.shared.fitting import fit_file
from plantfit.cases.shared.record import figure
from plantfit.cases.shared.stages import stages, within
from plantfit.cases.steam.dynamic_runs import Method, MethodRuns, method_runs
from plantfit.cases.steam.problems import dynamic_problem
from plantfit.cases.steam.sections.static_section import WANTED
from plantfit.cases.steam.sections.uncertainty_section import (
    constant_uncertainty,
    table_uncertainty,
    uncertainty_section,
    zero_left_in,
)
from plantfit.cases.steam.static_task import (
    DelayStudy,
    StaticTask,
    delay_study,
    early_dead_times,
    joint,
    two_step,
    two_step_by,
)
from plantfit.fitting import Answer
from plantfit.recording.record import Recording
from plantfit.rig.run import RigRun
from plantfit.rig.steam_chamber import OPENINGS
from plantfit.trust.validate.dead_time import DeadTime

STATIC_RUNS, STATIC_BUDGET = (1, 10), (600, 3000)  # of each method of the static task, for each step of each opening
DRAWS = (0, 200)  # refits of the parameters' uncertainty; 0: linear
QUIET = 0.001, 16  # noise (bar) and bits of a sensor that tells dead times
DELAY_SEEDS = range(1, 21)
VISITED = ("k[2]", "k[5]", "k[7]", "A1[2]", "A1[5]", "A2[2]", "A2[5]", "Td")  # entries whose uncertainty is shown
FIT, CONSTANTS = "least squares, every run", "dead times and uncertainty"


@dataclass(frozen=True)
class Asked:
    """Records with their truth, the study file, the static solution (d,) of the dynamic task, and the
    `methods` with so many runs (`count`) of `budget` evaluations."""

    runs: Mapping[str, RigRun]
    file: Path
    static: np.ndarray
    methods: Sequence[Method]
    count: int
    budget: int
    seed: int
    full: bool

    @property
    def recordings(self) -> dict[str, Recording]:
        """The record of every opening."""
        return {n: r.recording for n, r in self.runs.items()}


@dataclass(frozen=True)
class Constants:
    """The static task jointly and in two steps by three methods, dead times from the first 2 s, how well they are told
    over many records, and the section of the uncertainties."""

    tasks: tuple[StaticTask, ...]
    early: Mapping[str, DeadTime]
    study: tuple[DelayStudy, ...]
    uncertainty: dict[str, Any]

    def figures(self) -> list[dict[str, Any]]:
        """How well the quiet sensor tells dead times of openings that can tell them."""
        told = [s for s in self.study if (s.noise, s.bits) == QUIET and s.half_width <= WANTED]
        if not told:
            return []
        name = f"dead time from the first 2 s, {QUIET[0]:g} bar noise: openings that tell it to {WANTED:g} s"
        return [
            figure(name, float(len(told)), f"of {len(OPENINGS)}"),
            figure("of these, largest rms error over 20 records", max(s.rms for s in told), "s", WANTED, "asked for"),
        ]


@dataclass(frozen=True)
class Found:
    """What was `Asked` for."""

    methods: tuple[MethodRuns, ...]
    answer: Answer
    constants: Constants


def apart(asked: Asked, progress: Callable[[Any], None] | None = None) -> Found:
    """One after the other, so that it takes one core."""
    begins = stages((*(m.label for m in asked.methods), FIT, CONSTANTS), progress)
    problem, found = dynamic_problem(asked.recordings, weighted=True), []
    for m in asked.methods:
        begins(m.label)
        told = within(m.label, progress)
        found.append(method_runs(problem, m, asked.static, asked.count, asked.budget, asked.seed, told))
    begins(FIT)
    answer = fit_file(asked.file, within(FIT, progress))
    begins(CONSTANTS)
    return Found(tuple(found), answer, constants(asked.recordings, asked.full, asked.seed))


def constants(recordings: Mapping[str, Recording], full: bool, seed: int) -> Constants:
    """The static task, and the uncertainty of what is measured and found."""
    by = [two_step_by(recordings, m, STATIC_RUNS[full], STATIC_BUDGET[full]) for m in ("cmaes", "lbfgsb")]
    tasks = joint(recordings), two_step(recordings), *by
    study = [delay_study(0.05, 12, u, DELAY_SEEDS) for u in (10.0, 40.0, 100.0) if full]
    study += [delay_study(*QUIET, u, DELAY_SEEDS) for u in OPENINGS if full]
    shown = recordings["opening40"]
    found = table_uncertainty(shown, tasks[1].constants["opening40"], DRAWS[full], seed)
    told = constant_uncertainty(shown, DRAWS[full], seed)
    section = uncertainty_section("40", found, VISITED, zero_left_in(shown), told)
    return Constants(tasks, early_dead_times(recordings), tuple(study), section)
