"""The problem of a study file as a search sees it, made anew with the same bits in any process."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import spec
from plantfit.errors import RecordingError
from plantfit.optimize.contract import Objective
from plantfit.spec.error_place import errors_at
from plantfit.stages import Prepared, prepare
from plantfit.study.problem_recipe import STUDY_FILES, Recipe


def searched(
    text: str, path: str, files: Mapping[str, Path], start: np.ndarray | None
) -> tuple[Objective, Callable[[Any], Any]]:
    """The `Maker` of studies that were begun from a study file."""
    prepared = prepared_study(spec.parse(text, path, files), start)
    return prepared.objective, prepared.to_physical


def prepared_study(study: spec.Study, start: np.ndarray | None = None) -> Prepared:
    """The problem of a study file as its plan searches it; `start` (k, d) replaces what multiple shooting would have
    to find."""
    shooting = study.table.search.shooting
    with errors_at(study.path.name if shooting is None else f"{study.path.name}, [search] shooting"):
        return prepare(study.problem, shooting=shooting, seed=study.plan.seed, start=start)


def recipe_of(study: spec.Study) -> Recipe:
    """The study with the bytes of its recordings, for machines that share no disk. Raises RecordingError."""
    table = study.table
    named = [(f"Recording {n!r}", r.file) for n, r in table.recording.items()]
    named += [(f"Table {n!r}", t.file) for n, t in table.model.tables.items() if t.file is not None]
    files = {}
    for name, file in named:
        place = spec.named_file(file, study.path)
        try:
            files[file] = place.read_bytes()
        except OSError as error:
            raise RecordingError(
                f"{name} cannot be read: {place} ({error.strerror or error}); put the file there."
            ) from error
    return Recipe(STUDY_FILES, study.text, str(study.path), files)
