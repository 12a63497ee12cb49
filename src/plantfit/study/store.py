"""The study database: every method is one transaction, and every failure one sentence."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from sqlalchemy import Connection, Engine, Row, delete, func, insert, select, update

from plantfit.errors import StoreError
from plantfit.study import claims, tables
from plantfit.study.claims import Claim
from plantfit.study.codec import from_json, to_json
from plantfit.study.engine import WRITES, connect
from plantfit.study.export import write_json, write_parquet
from plantfit.study.failures import readable, translated
from plantfit.study.migrations import VERSION, current_version, migrate
from plantfit.study.plan import Plan, tasks
from plantfit.study.records import RunRecord, StudyRecord
from plantfit.study.rows import run_record, run_row, study_record
from plantfit.study.versions import cpu_model, versions

if TYPE_CHECKING:
    from plantfit.optimize.contract import RunResult


class Store:
    """Studies in one database; open it with `Store.open`. May be shared by threads and processes.

    Raises StoreError when the database is missing, locked, read-only, full, damaged or of a newer
    plantfit; what was finished before stays in it.
    """

    def __init__(self, engine: Engine, name: str):
        self.engine, self.name = engine, name
        self._writer = engine.execution_options(**{WRITES: True})

    @classmethod
    def open(cls, place: str | os.PathLike[str], *, create: bool = True, busy_timeout: float = 30.0) -> "Store":
        """Open a file (made if `create`) or a SQLAlchemy URL, waiting up to `busy_timeout` s for locks."""
        store = cls(*connect(place, busy_timeout, create))
        with store._read() as connection:
            newest = current_version(connection, store.name) == VERSION
        if not newest:  # only then write, so that a database can be read where it cannot be written
            with store._write() as connection:
                migrate(connection, store.name)
        return store

    # studies

    def add(self, plan: Plan, *, spec_text: str | None, coordinates: Sequence[str], probe: bytes, spec_path: str | None = None) -> int:
        """A new study with all its tasks open; returns its id."""
        row = {
            "name": plan.name,
            "created": claims.utc_now(),
            "state": "running",
            "plan": to_json(plan.record()),
            "spec": spec_text,
            "spec_path": spec_path,
            "coordinates": to_json(list(coordinates)),
            "versions": to_json(versions()),
            "cpu": cpu_model(),
            "notes": to_json([]),
            "probe": probe,
        }
        with self._write() as connection:
            key = connection.execute(insert(tables.study).values(row)).inserted_primary_key
            study_id = int(key[0])  # pyright: ignore[reportOptionalSubscript]
            claims.add_tasks(connection, study_id, tasks(plan))
        return study_id

    def studies(self) -> list[StudyRecord]:
        """All studies, oldest first."""
        with self._read() as connection:
            return [self._study(connection, row) for row in connection.execute(select(tables.study).order_by(tables.study.c.id))]

    def study(self, study_id: int) -> StudyRecord:
        """One study."""
        with self._read() as connection:
            return self._study(connection, self._row(connection, study_id))

    def plan(self, study_id: int) -> Plan:
        """The plan of a study; SearchError if one of its methods is not installed here."""
        return Plan.from_record(self.study(study_id).plan)

    def probe(self, study_id: int) -> bytes:
        """The fingerprint of the problem that the study began with."""
        with self._read() as connection:
            return self._row(connection, study_id).probe

    def delete(self, study_id: int) -> None:
        """Delete a study with its runs; StoreError while a live worker holds one of its tasks."""
        with self._write() as connection:
            self._row(connection, study_id)
            if claims.is_held(connection, study_id, time.time()):
                raise StoreError(f"Study {study_id} in {self.name} is running; stop it before deleting it.")
            connection.execute(delete(tables.study).where(tables.study.c.id == study_id))

    def settle(self, study_id: int, *, active: bool) -> None:
        """Set the state from the tasks: "done", else "running" if the caller or a live worker is at it, else "interrupted"."""
        with self._write() as connection:
            open_tasks = select(func.count()).where(tables.task.c.study == study_id, tables.task.c.state == "open")
            at_work = active or claims.is_held(connection, study_id, time.time())
            state = "done" if connection.scalar(open_tasks) == 0 else "running" if at_work else "interrupted"
            connection.execute(update(tables.study).where(tables.study.c.id == study_id).values(state=state))

    def add_note(self, study_id: int, sentence: str) -> None:
        """Append a sentence to the study's notes, once."""
        with self._write() as connection:
            notes = from_json(self._row(connection, study_id).notes)
            if sentence not in notes:
                connection.execute(update(tables.study).where(tables.study.c.id == study_id).values(notes=to_json([*notes, sentence])))

    # runs

    def runs(self, study_id: int) -> list[RunRecord]:
        """Finished runs, in the order of the plan's methods, then by run."""
        with self._read() as connection:
            plan = self._row(connection, study_id).plan
            rows = connection.execute(select(tables.run).where(tables.run.c.study == study_id)).all()
        with readable(self.name, study_id):
            methods = from_json(plan)["methods"]
            return [run_record(row) for row in sorted(rows, key=lambda r: (methods.index(r.method), r.run))]

    def export_json(self, study_id: int, path: str | os.PathLike[str]) -> None:
        """Study and runs as JSON; floats in their shortest exact form, null for NaN and infinities."""
        write_json(self.study(study_id), self.runs(study_id), Path(path))

    def export_parquet(self, study_id: int, path: str | os.PathLike[str]) -> None:
        """One row per run: method, run, seed, cost, ..., one column per parameter, history as lists."""
        write_parquet(self.study(study_id), self.runs(study_id), Path(path))

    # tasks, for workers

    def claim(self, study_id: int, worker: str) -> Claim | None:
        """The next free task, now held by `worker`, or None when all are done or held."""
        with self._write() as connection:
            self._row(connection, study_id)
            return claims.take(connection, study_id, worker, time.time())

    def beat(self, claim: Claim) -> None:
        """Say that the holder lives; ClaimLost if it was taken over."""
        with self._write() as connection:
            claims.change(connection, claim, heartbeat=time.time())

    def save_checkpoint(self, claim: Claim, checkpoint: bytes) -> None:
        """Keep where the task stands; ClaimLost if it was taken over."""
        with self._write() as connection:
            claims.change(connection, claim, checkpoint=checkpoint, heartbeat=time.time())

    def release(self, claim: Claim, checkpoint: bytes | None = None) -> None:
        """Give the task back, open, with its newest checkpoint; ClaimLost if it was taken over."""
        newest = {} if checkpoint is None else {"checkpoint": checkpoint}
        with self._write() as connection:
            claims.change(connection, claim, claimed_by=None, heartbeat=None, **newest)

    def finish(self, claim: Claim, results: Sequence["RunResult"], parameters: Sequence[dict[str, float]]) -> None:
        """Write the task's runs and mark it done, both or neither; ClaimLost if it was taken over."""
        rows = [run_row(claim.study, result, values) for result, values in zip(results, parameters, strict=True)]
        with self._write() as connection:
            claims.change(connection, claim, state="done", checkpoint=None, claimed_by=None, heartbeat=None)
            connection.execute(insert(tables.run), rows)

    def counts(self, study_id: int) -> tuple[int, int, int, float, float]:
        """Tasks done, tasks, runs done, evaluations of those runs, their lowest cost (inf if none)."""
        task, run = tables.task.c, tables.run.c
        with self._read() as connection:
            total = connection.scalar(select(func.count()).where(task.study == study_id)) or 0
            done = connection.scalar(select(func.count()).where(task.study == study_id, task.state == "done")) or 0
            query = select(func.count(), func.sum(run.evaluations), func.min(run.cost)).where(run.study == study_id)
            runs, evaluations, best = connection.execute(query).one()
        return done, total, runs, evaluations or 0.0, np.inf if best is None else best

    # transactions

    @contextmanager
    def _transaction(self, engine: Engine) -> Iterator[Connection]:
        with translated(self.name), engine.begin() as connection:
            yield connection

    def _read(self):
        return self._transaction(self.engine)

    def _write(self):
        return self._transaction(self._writer)

    def _row(self, connection: Connection, study_id: int) -> Row:
        row = connection.execute(select(tables.study).where(tables.study.c.id == study_id)).one_or_none()
        if row is None:
            known = list(connection.scalars(select(tables.study.c.id).order_by(tables.study.c.id)))
            has = f"it has the studies {known}" if known else "it has none"
            raise StoreError(f"Study database {self.name} has no study {study_id!r}; {has}.")
        return row

    def _study(self, connection: Connection, row: Row) -> StudyRecord:
        runs = connection.scalar(select(func.count()).where(tables.run.c.study == row.id)) or 0
        with readable(self.name, row.id):
            return study_record(row, claims.is_held(connection, row.id, time.time()), runs)
