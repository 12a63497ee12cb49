"""A stored study as an `Answer`: its problem made anew, with the steps and the ends of its runs that finishing
found."""

import difflib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import plantfit.runtime  # noqa: F401
from plantfit import spec
from plantfit.answer import Answer
from plantfit.errors import StoreError
from plantfit.problem.problem import Problem
from plantfit.stages import Prepared, judged_in_store, stated_in_file, stored_runs
from plantfit.study.store.addresses import STORE, VARIABLE, shown
from plantfit.study.store.records import StudyRecord
from plantfit.study.store.store import Store
from plantfit.trust.stated_errors.shared_error import SharedError


def open_study(
    study: str | int,
    store: Store | str | os.PathLike[str] | None = None,
    *,
    problem: Problem | None = None,
    errors: Sequence[SharedError] | None = None,
    draws: int | None = None,
) -> Answer:
    """The answer of a stored study: the same values, findings and predictions as when it was fitted.

    `study` is a name, of which the newest study is taken, or a number. `store` is a file, an address or a Store; by
    default the environment variable PLANTFIT_STORE, else plantfit.db. The problem is made anew from the study file that
    the store keeps and the recordings beside the place where that file lay. Of a problem that was written in Python the
    store has nothing but its runs: give the same `problem` again, and its cost is compared with that of the day.
    `errors` and `draws` are by default those of the study file.

    What finishing found (steps, scales, the ends of the runs) is kept in the store. It is used for the same problem and
    runs by the same plantfit on the same kind of machine; else the study is finished anew.

    A study with runs that are not finished gives the answer of those that are. Raises StoreError for a store, a name or
    a number that is not there, for a study without finished runs and for another problem, RecordingError for recordings
    that are gone.
    """
    opened = (
        store
        if isinstance(store, Store)
        else Store.open(os.environ.get(VARIABLE, STORE) if store is None else store, create=False)
    )
    record = _found(opened, study)
    runs = stored_runs(opened, record.id)  # what is not finished is said before any work
    read = study_of(record) if problem is None else None
    given = problem if read is None else read.problem
    assert given is not None
    file = given.study_file
    return judged_in_store(
        opened, record.id, given, runs, refuse=True, seed=int(record.plan["seed"]),
        spec=None if file is None else file.text,
        command=_command(record, read) if read else "", seconds={}, stated=stated_in_file(given, errors, draws),
    )  # fmt: skip


def study_of(record: StudyRecord, path: str | Path = "study.toml") -> spec.Study:
    """The study file of a stored study; `path` is where it lies if the store does not say.

    Raises StoreError where the study was begun from Python, and the errors of `spec.parse`.
    """
    if not record.spec_text:
        raise StoreError(
            f"Study {record.id} ({record.name}) was made from Python without a study file; use "
            f"its script to go on, or open it with pf.open_study({record.id}, problem=...)."
        )
    return spec.parse(record.spec_text, record.spec_path or path)


def answer_of(
    store: Store, record: StudyRecord, study: spec.Study, seconds: Mapping[str, float], prepared: Prepared | None = None
) -> Answer:
    """The answer of a study that was begun from a study file, whose problem may be `prepared` already.

    Raises StoreError where no run is finished.
    """
    return judged_in_store(
        store, record.id, study.problem, stored_runs(store, record.id), prepared, seed=int(record.plan["seed"]),
        spec=study.text,
        command=_command(record, study), seconds=seconds, stated=(study.errors, study.draws),
    )  # fmt: skip


def _command(record: StudyRecord, study: spec.Study) -> str:
    """What repeats the study, if its plan is that of its file: one that was begun from Python may have another."""
    planned = study.plan.record()
    same = all(record.plan.get(key) == planned[key] for key in ("methods", "runs", "budget", "seed", "settings"))
    return f"plantfit run {study.path.name}" if same else ""


def _found(store: Store, study: str | int) -> StudyRecord:
    if not isinstance(study, str):
        return store.study(study)
    records = store.studies()
    own = [r for r in records if r.name == study]
    if own:
        return own[-1]
    names = list(dict.fromkeys(r.name for r in records))
    if not names:
        raise StoreError(
            f"{shown(store.name)} holds no study yet; start one with "
            "`plantfit run STUDY.toml` or pf.fit(problem, store=...)."
        )
    near = difflib.get_close_matches(study, names, 3, 0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}?" if near else f"it has {', '.join(map(repr, names[-8:]))}."
    raise StoreError(f"{shown(store.name)} holds no study {study!r}; {hint}")
