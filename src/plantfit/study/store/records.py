"""What the store gives back: plain records of a study and of one finished run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import Status


@dataclass(frozen=True)
class StudyRecord:
    """A study as the database has it.

    `state` is "running" while a live worker holds a task, "done" when every run is finished and
    "interrupted" otherwise. `created` is UTC in ISO 8601; `plan` is `Plan.record()`.
    """

    id: int
    name: str
    created: str
    state: str
    plan: Mapping[str, Any]
    spec_text: str | None
    spec_path: str | None
    coordinates: tuple[str, ...]
    versions: Mapping[str, str]
    cpu: str
    notes: tuple[str, ...]
    runs_done: int
    runs_total: int


@dataclass(frozen=True)
class RunRecord:
    """One finished run: `x` (d,) in the unit cube, `parameters` the same in declared units.

    `history_evaluations` and `history_cost` (k,) are the evaluations spent and the best cost at
    each improvement and at the end. Every float is bit for bit what the method returned.
    """

    method: str
    run: int
    seed: int
    x: np.ndarray
    cost: float
    parameters: Mapping[str, float]
    evaluations: float
    seconds: float
    status: Status
    failures: int
    history_evaluations: np.ndarray
    history_cost: np.ndarray
    extra: Mapping[str, Any]


@dataclass(frozen=True)
class TaskRecord:
    """Runs `first` to `first + count - 1` of a method, all of them finished or none; `checkpoint` is where an open
    task stands."""

    method: str
    first: int
    count: int
    done: bool
    checkpoint: bytes | None


@dataclass(frozen=True)
class WholeStudy:
    """All that another store needs to show a study, compare it and go on with it, read in one moment."""

    study: StudyRecord
    probe: bytes
    tasks: tuple[TaskRecord, ...]
    runs: tuple[RunRecord, ...]
