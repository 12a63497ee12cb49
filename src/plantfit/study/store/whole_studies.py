"""Whole studies in and out of the tables, as statements on an open transaction; nothing here commits."""

from collections.abc import Iterable, Mapping
from typing import Any

from sqlalchemy import Connection, Row, insert, select, update

from plantfit.study.store import tables
from plantfit.study.store.claims import utc_now
from plantfit.study.store.codec import from_json, to_json
from plantfit.study.store.records import RunRecord, TaskRecord, WholeStudy
from plantfit.study.store.rows import run_record, run_row


def insert_study(connection: Connection, row: Mapping[str, Any]) -> int:
    """A row of table study; returns its id, which no study of the database ever had."""
    key = connection.execute(insert(tables.study).values(row)).inserted_primary_key
    return int(key[0])  # pyrefly: ignore[unsupported-operation]


def insert_whole(connection: Connection, whole: WholeStudy) -> int:
    """A study from elsewhere as a new one, held by nobody; returns its id."""
    study, finished = whole.study, all(t.done for t in whole.tasks)
    study_id = insert_study(
        connection,
        {
            "name": study.name,
            "created": study.created,
            "state": "done" if finished else "interrupted",
            "plan": to_json(study.plan),
            "spec": study.spec_text,
            "spec_path": study.spec_path,
            "coordinates": to_json(list(study.coordinates)),
            "versions": to_json(study.versions),
            "cpu": study.cpu,
            "notes": to_json(list(study.notes)),
            "probe": whole.probe,
        },
    )
    connection.execute(insert(tables.task), [_task_row(study_id, t) for t in whole.tasks])
    insert_runs(connection, study_id, whole.runs)
    return study_id


def insert_runs(connection: Connection, study_id: int, runs: Iterable[RunRecord]) -> None:
    """Finished runs from elsewhere."""
    rows = [run_row(study_id, r, r.parameters) for r in runs]
    if rows:
        connection.execute(insert(tables.run), rows)


def task_records(connection: Connection, study_id: int) -> tuple[TaskRecord, ...]:
    """The tasks of a study in their order."""
    task = tables.task.c
    columns = (task.method, task.first, task["count"], task.state, task.checkpoint)
    rows = connection.execute(select(*columns).where(task.study == study_id).order_by(task.id))
    return tuple(
        TaskRecord(method, first, count, state == "done", checkpoint)
        for method, first, count, state, checkpoint in rows
    )


def run_records(connection: Connection, study: Row) -> list[RunRecord]:
    """The finished runs of a row of table study, in the order of its methods, then by run."""
    methods = from_json(study.plan)["methods"]
    rows = connection.execute(select(tables.run).where(tables.run.c.study == study.id)).all()
    return [run_record(row) for row in sorted(rows, key=lambda r: (methods.index(r.method), r.run))]


def add_notes(connection: Connection, study: Row, sentences: Iterable[str]) -> None:
    """Append sentences that the row of table study, locked by the caller, does not have yet."""
    notes = from_json(study.notes)
    fresh = [s for s in dict.fromkeys(sentences) if s not in notes]
    if fresh:
        connection.execute(
            update(tables.study).where(tables.study.c.id == study.id).values(notes=to_json([*notes, *fresh]))
        )


def _task_row(study_id: int, task: TaskRecord) -> dict[str, Any]:
    return {
        "study": study_id,
        "method": task.method,
        "first": task.first,
        "count": task.count,
        "state": "done" if task.done else "open",
        "checkpoint": task.checkpoint,
        "updated": utc_now(),
    }
