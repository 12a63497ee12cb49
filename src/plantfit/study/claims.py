"""Tasks and their claims, as statements on an open transaction; nothing here commits."""

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import Connection, and_, insert, select, update

from plantfit.study import tables
from plantfit.study.plan import Task
from plantfit.study.worker import is_stale

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


def utc_now() -> str:
    """Now in UTC, ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def add_tasks(connection: Connection, study: int, planned: tuple[Task, ...]) -> None:
    """Open tasks of a new study, in their order."""
    rows = [
        {"study": study, "method": t.method, "first": t.first, "count": t.count, "state": "open", "updated": utc_now()} for t in planned
    ]
    connection.execute(insert(TABLE), rows)


def take(connection: Connection, study: int, worker: str, now: float) -> Claim | None:
    """The first open task that nobody alive holds, now held by `worker`; None if there is none."""
    for row in connection.execute(select(TABLE).where(TABLE.c.study == study, TABLE.c.state == "open").order_by(TABLE.c.id)):
        if not is_stale(row.claimed_by, row.heartbeat, now):
            continue
        # the old holder stands in the condition: of two takers only one matches
        unchanged = and_(TABLE.c.id == row.id, TABLE.c.state == "open", TABLE.c.claimed_by.is_not_distinct_from(row.claimed_by))
        taken = connection.execute(update(TABLE).where(unchanged).values(claimed_by=worker, heartbeat=now, updated=utc_now()))
        if taken.rowcount == 1:
            return Claim(row.id, study, worker, Task(row.method, row.first, row._mapping[TABLE.c["count"]]), row.checkpoint)
    return None


def change(connection: Connection, claim: Claim, **values: object) -> None:
    """Update the task if it is still held; raises ClaimLost otherwise."""
    held = and_(TABLE.c.id == claim.id, TABLE.c.state == "open", TABLE.c.claimed_by == claim.worker)
    if connection.execute(update(TABLE).where(held).values(updated=utc_now(), **values)).rowcount != 1:
        raise ClaimLost


def is_held(connection: Connection, study: int, now: float) -> bool:
    """Whether a live worker holds a task of the study."""
    rows = connection.execute(select(TABLE.c.claimed_by, TABLE.c.heartbeat).where(TABLE.c.study == study, TABLE.c.state == "open"))
    return any(not is_stale(row.claimed_by, row.heartbeat, now) for row in rows)
