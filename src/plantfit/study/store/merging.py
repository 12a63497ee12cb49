"""Studies from several stores in one: the same study worked on at two places becomes one study."""

from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import Connection, Row, and_, select, update

from plantfit.errors import StoreError
from plantfit.study.running.probe import check_same
from plantfit.study.store import tables
from plantfit.study.store.claims import utc_now
from plantfit.study.store.codec import from_json, to_blob, to_json
from plantfit.study.store.records import RunRecord, StudyRecord, WholeStudy
from plantfit.study.store.whole_studies import add_notes, insert_runs, insert_whole, run_records

MEASURED = ("compile_seconds",)  # entries of extra that, like `seconds`, are another time's whatever the bits


@dataclass(frozen=True)
class Merged:
    """What became of a study from elsewhere: `study` is its id here, `new` if it was not here before.

    `added` runs came from there, `equal` runs were here already with the same bits, `different`
    runs were here with other bits and are kept. `notes` are the sentences added to the study.
    """

    study: int
    new: bool
    added: int
    equal: int
    different: int
    notes: tuple[str, ...]


def find_same(connection: Connection, whole: WholeStudy) -> int | None:
    """The study here with the same plan, spec, coordinates and problem, begun at the same time if there are several."""
    study, theirs = tables.study.c, whole.study
    columns = (study.id, study.plan, study.spec, study.coordinates, study.created, study.probe)
    same = [
        row
        for row in connection.execute(select(*columns).where(study.name == theirs.name).order_by(study.id))
        if _is_same(row, whole)
    ]
    return min(same, key=lambda row: row.created != theirs.created).id if same else None


def merge(connection: Connection, whole: WholeStudy, origin: str) -> Merged:
    """Unite the study with the same one here, or add it; `origin` is the place it comes from."""
    study_id = find_same(connection, whole)
    if study_id is None:
        note = f"Came from {_there(whole.study, origin)}."
        added = replace(whole, study=replace(whole.study, notes=(*whole.study.notes, note)))
        return Merged(insert_whole(connection, added), True, len(whole.runs), 0, 0, (note,))
    row = connection.execute(select(tables.study).where(tables.study.c.id == study_id).with_for_update()).one()
    return _unite(connection, row, whole, origin)


def first_difference(ours: RunRecord, theirs: RunRecord) -> str | None:
    """The first field of two runs that differs in a bit, with both values; None if they are the same."""
    a, b = _bits(ours), _bits(theirs)
    for name in a:
        if a[name] != b[name]:
            here, there = getattr(ours, name), getattr(theirs, name)
            return f"{name} ({here!r} here, {there!r} there)" if isinstance(here, int | float | str) else name
    return None


def _unite(connection: Connection, study: Row, whole: WholeStudy, origin: str) -> Merged:
    ours = {(r.method, r.run): r for r in run_records(connection, study)}
    both = [(ours[r.method, r.run], r) for r in whole.runs if (r.method, r.run) in ours]
    different = [(b, found) for a, b in both if (found := first_difference(a, b)) is not None]
    added = _take_tasks(connection, study, whole)
    _settle(connection, study)
    there, notes = _there(whole.study, origin), list[str]()
    equal = len(both) - len(different)
    if added:
        notes += whole.study.notes
        notes += [
            f"{added} runs came from {there}{_elsewhere(study, whole.study)}; "
            f"{equal} runs were here already with the same bits."
        ]
    if different:
        run, found = different[0]
        more = f", and {len(different) - 1} more runs differ" if len(different) > 1 else ""
        notes += [
            f"Run {run.run} of {run.method!r} differs from that of {there} in {found}{more}; those here are kept."
        ]
    add_notes(connection, study, notes)
    return Merged(study.id, False, added, equal, len(different), tuple(notes))


def _take_tasks(connection: Connection, study: Row, whole: WholeStudy) -> int:
    """Finish open tasks of which all runs are there, take checkpoints where there is none here; returns the runs
    added."""
    task = tables.task
    theirs = {(r.method, r.run): r for r in whole.runs}
    checkpoints = {(t.method, t.first, t.count): t.checkpoint for t in whole.tasks if t.checkpoint is not None}
    rows = connection.execute(
        select(task).where(task.c.study == study.id, task.c.state == "open").order_by(task.c.id).with_for_update()
    )
    added = 0
    for row in rows.all():
        span = (row.method, row.first, row._mapping[task.c["count"]])
        wanted = [(row.method, k) for k in range(row.first, row.first + span[2])]
        if all(key in theirs for key in wanted):
            # a live worker on it learns at its next save that the task is no longer its own
            done = {"state": "done", "checkpoint": None, "claimed_by": None, "heartbeat": None, "evaluations": None}
            connection.execute(update(task).where(task.c.id == row.id).values(updated=utc_now(), **done))
            insert_runs(connection, study.id, [theirs[key] for key in wanted])
            added += len(wanted)
        elif row.checkpoint is None and row.claimed_by is None and span in checkpoints:
            connection.execute(
                update(task).where(task.c.id == row.id).values(checkpoint=checkpoints[span], updated=utc_now())
            )
    return added


def _settle(connection: Connection, study: Row) -> None:
    task = tables.task.c
    left = connection.scalar(select(task.id).where(and_(task.study == study.id, task.state == "open")).limit(1))
    if left is None:
        connection.execute(update(tables.study).where(tables.study.c.id == study.id).values(state="done"))


def _is_same(row: Row, whole: WholeStudy) -> bool:
    theirs = whole.study
    if (from_json(row.plan), row.spec, tuple(from_json(row.coordinates))) != (
        theirs.plan,
        theirs.spec_text,
        theirs.coordinates,
    ):
        return False
    try:
        check_same(row.probe, whole.probe, row.id)
    except StoreError:
        return False
    return True


def _there(study: StudyRecord, origin: str) -> str:
    number = f"study {study.id} of " if study.id else ""
    return f"{number}{origin} (begun {study.created} on {study.cpu})"


def _elsewhere(study: Row, theirs: StudyRecord) -> str:
    """What the runs there were computed with, as far as it is not the same as here."""
    here, there = from_json(study.versions) | {"CPU": study.cpu}, dict(theirs.versions) | {"CPU": theirs.cpu}
    changed = [
        f"{key} {there.get(key, 'unknown')} there, {here[key]} here" for key in here if here[key] != there.get(key)
    ]
    return (
        f", computed with other software or another CPU ({', '.join(changed)}), so that last bits may differ"
        if changed
        else ""
    )


def _bits(run: RunRecord) -> dict[str, Any]:
    """The fields of a run as values that are equal if and only if all bits are."""
    extra = {key: value for key, value in run.extra.items() if key not in MEASURED}
    return {
        "seed": run.seed,
        "status": run.status.value,
        "failures": run.failures,
        "cost": to_blob([run.cost]),
        "evaluations": to_blob([run.evaluations]),
        "x": to_blob(run.x),
        "parameters": to_json(run.parameters),
        "history_evaluations": to_blob(run.history_evaluations),
        "history_cost": to_blob(run.history_cost),
        "extra": to_json(extra),
    }
