"""The problem of a study file as a search sees it, made anew with the same bits in any process."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import spec
from plantfit.errors import RecordingError
from plantfit.fitting import prepare, shooting_starts
from plantfit.optimize.contract import Objective
from plantfit.problem import Problem
from plantfit.study.objective import objective_of
from plantfit.study.problem_recipe import STUDY_FILES, Recipe


def searched(text: str, path: str, files: Mapping[str, Path], start: np.ndarray | None) -> tuple[Objective, Callable[[Any], Any]]:
    """The `Maker` of studies that were begun from a study file."""
    study = spec.parse(text, path, files)
    problem = prepare(study.problem)
    return objective(study, problem, start), problem.space.physical


def objective(study: spec.Study, problem: Problem, start: np.ndarray | None = None) -> Objective:
    """What a study searches; `problem` is that of the study, prepared."""
    if start is None:
        start = shooting_starts(problem, study.table.search.shooting, study.plan.seed)
    return objective_of(problem, start)


def recipe_of(study: spec.Study) -> Recipe:
    """The study with the bytes of its recordings, for machines that share no disk. Raises RecordingError."""
    files = {}
    for name, recording in study.table.recording.items():
        place = spec.recording_file(recording, study.path)
        try:
            files[recording.file] = place.read_bytes()
        except OSError as error:
            raise RecordingError(f"Recording {name!r} cannot be read: {place} ({error.strerror or error}); put the file there.") from error
    return Recipe(STUDY_FILES, study.text, str(study.path), files)
