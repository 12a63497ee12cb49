"""Tasks and their claims, as statements on an open transaction; nothing here commits."""

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import Connection, Row, and_, insert, select, update

from plantfit.study.plan import Task
from plantfit.study.running.worker_names import is_stale
from plantfit.study.store import tables

TABLE = tables.task


class ClaimLost(Exception):
    """Another worker took the task over; internal to the study room."""


@dataclass(frozen=True)
class Claim:
    """A task held by a worker, with the checkpoint to go on from."""

    id: int
    study: int
    worker: str
    task: Task
    checkpoint: bytes | None


@dataclass(frozen=True)
class Held:
    """A task in work: who holds it, seconds since its last sign of life, evaluations it has told (None before)."""

    worker: str
    task: Task
    silent: float
    evaluations: float | None


_HELD = (TABLE.c.claimed_by, TABLE.c.method, TABLE.c.first, TABLE.c["count"], TABLE.c.heartbeat, TABLE.c.evaluations)


def utc_now() -> str:
    """Now in UTC, ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def add_tasks(connection: Connection, study: int, planned: tuple[Task, ...]) -> None:
    """Open tasks of a new study, in their order."""
    rows = [
        {"study": study, "method": t.method, "first": t.first, "count": t.count, "state": "open", "updated": utc_now()}
        for t in planned
    ]
    connection.execute(insert(TABLE), rows)


def take(connection: Connection, study: int, worker: str, now: float) -> Claim | None:
    """The first open task that nobody alive holds, now held by `worker`; None if there is none."""
    seen = select(TABLE.c.id, TABLE.c.claimed_by, TABLE.c.heartbeat).where(
        TABLE.c.study == study, TABLE.c.state == "open"
    )
    for row in connection.execute(seen.order_by(TABLE.c.id)).all():
        if (
            is_stale(row.claimed_by, row.heartbeat, now)
            and (claim := _take_one(connection, row, worker, now)) is not None
        ):
            return claim
    return None


def _take_one(connection: Connection, seen: Row, worker: str, now: float) -> Claim | None:
    """The task as it was seen, or None if another worker was faster."""
    # the old holder stands in the condition: of two takers only one matches; PostgreSQL locks the row, SQLite the file
    unchanged = and_(
        TABLE.c.id == seen.id,
        TABLE.c.state == "open",
        TABLE.c.claimed_by.is_not_distinct_from(seen.claimed_by),
        TABLE.c.heartbeat.is_not_distinct_from(seen.heartbeat),
    )
    row = connection.execute(select(TABLE).where(unchanged).with_for_update(skip_locked=True)).one_or_none()
    if row is None:
        return None
    connection.execute(
        update(TABLE)
        .where(TABLE.c.id == row.id)
        .values(claimed_by=worker, heartbeat=now, evaluations=None, updated=utc_now())
    )
    return Claim(row.id, row.study, worker, Task(row.method, row.first, row._mapping[TABLE.c["count"]]), row.checkpoint)


def change(connection: Connection, claim: Claim, **values: object) -> None:
    """Update the task if it is still held; raises ClaimLost otherwise."""
    held = and_(TABLE.c.id == claim.id, TABLE.c.state == "open", TABLE.c.claimed_by == claim.worker)
    if connection.execute(update(TABLE).where(held).values(updated=utc_now(), **values)).rowcount != 1:
        raise ClaimLost


def held(connection: Connection, study: int, now: float) -> list[Held]:
    """Tasks of the study that a live worker holds, in their order."""
    rows = connection.execute(
        select(*_HELD).where(TABLE.c.study == study, TABLE.c.state == "open").order_by(TABLE.c.id)
    )
    return [
        Held(r.claimed_by, Task(r.method, r.first, r._mapping[TABLE.c["count"]]), now - r.heartbeat, r.evaluations)
        for r in rows
        if not is_stale(r.claimed_by, r.heartbeat, now)
    ]


def is_held(connection: Connection, study: int, now: float) -> bool:
    """Whether a live worker holds a task of the study."""
    return bool(held(connection, study, now))
