"""The study database: every method is one transaction, and every failure one sentence."""

import os
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Connection, Engine, Row, delete, func, insert, inspect, select, update

from plantfit.errors import StoreError
from plantfit.study.plan import Plan, tasks
from plantfit.study.store import claims, tables
from plantfit.study.store.claims import Claim, Held
from plantfit.study.store.codec import to_json
from plantfit.study.store.database_engine import clock_ahead, connect, one_at_a_time, readers, writers
from plantfit.study.store.database_failures import readable, translated
from plantfit.study.store.export import write_json, write_parquet
from plantfit.study.store.importing import read_study
from plantfit.study.store.merging import Merged, find_same, merge
from plantfit.study.store.migrations import VERSION, current_version, migrate
from plantfit.study.store.records import RunRecord, StudyRecord, WholeStudy
from plantfit.study.store.rows import run_row, study_record
from plantfit.study.store.whole_studies import add_notes, insert_study, insert_whole, run_records, task_records
from plantfit.study.versions import cpu_model, versions

if TYPE_CHECKING:
    from plantfit.optimize.contract import RunResult

# row locks of PostgreSQL; SQLite locks the file when a writer begins
WHOLE: dict[str, Any] = {}  # the study is about to change, and nobody else may change it
EXISTENCE: dict[str, Any] = {"read": True, "key_share": True}  # it must not be deleted meanwhile


class Store:
    """Studies in one database; open it with `Store.open`. May be shared by threads and processes.

    Raises StoreError when the database is missing, locked, read-only, full, damaged or of a newer
    plantfit; what was finished before stays in it.
    """

    def __init__(self, engine: Engine, name: str):
        self.engine, self.name = engine, name
        self._reader, self._writer = readers(engine), writers(engine)
        self._clock_ahead = 0.0
        self._address = engine.url.render_as_string(hide_password=False)

    @classmethod
    def open(cls, place: str | os.PathLike[str], *, create: bool = True, busy_timeout: float = 30.0) -> "Store":
        """Open a file (made if `create`) or a PostgreSQL URL, waiting up to `busy_timeout` s for locks. Raises
        StoreError."""
        store = cls(*connect(place, busy_timeout, create))
        with store._read() as connection:
            newest = current_version(connection, store.name) == VERSION
            store._clock_ahead = clock_ahead(connection, time.time())
        if not newest:  # only then write, so that a database can be read where it cannot be written
            with store._write() as connection:
                migrate(connection, store.name)
        return store

    @property
    def address(self) -> str:
        """What opens this database in another process: the path, or the URL with its password."""
        url = self.engine.url
        return (
            str(Path(self.name).resolve())
            if url.get_backend_name() == "sqlite"
            else url.render_as_string(hide_password=False)
        )

    # studies

    def add(
        self,
        plan: Plan,
        *,
        spec_text: str | None,
        coordinates: Sequence[str],
        probe: bytes,
        spec_path: str | None = None,
    ) -> int:
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
            study_id = insert_study(connection, row)
            claims.add_tasks(connection, study_id, tasks(plan))
        return study_id

    def studies(self) -> list[StudyRecord]:
        """All studies, oldest first."""
        with self._read() as connection:
            return [
                self._study(connection, row)
                for row in connection.execute(select(tables.study).order_by(tables.study.c.id))
            ]

    def study(self, study_id: int) -> StudyRecord:
        """One study. Raises StoreError if there is none of this number."""
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
            self._row(connection, study_id, lock=WHOLE)
            if claims.is_held(connection, study_id, self._now()):
                raise StoreError(f"Study {study_id} in {self.name} is running; stop it before deleting it.")
            connection.execute(delete(tables.study).where(tables.study.c.id == study_id))

    def settle(self, study_id: int, *, active: bool) -> None:
        """Set the state from the tasks: "done", else "running" if the caller or a live worker is at it, else
        "interrupted"."""
        with self._write() as connection:
            self._row(connection, study_id, lock=WHOLE)
            open_tasks = select(func.count()).where(tables.task.c.study == study_id, tables.task.c.state == "open")
            at_work = active or claims.is_held(connection, study_id, self._now())
            state = "done" if connection.scalar(open_tasks) == 0 else "running" if at_work else "interrupted"
            connection.execute(update(tables.study).where(tables.study.c.id == study_id).values(state=state))

    def add_note(self, study_id: int, sentence: str) -> None:
        """Append a sentence to the study's notes, once."""
        with self._write() as connection:
            add_notes(connection, self._row(connection, study_id, lock=WHOLE), [sentence])

    # runs

    def runs(self, study_id: int) -> list[RunRecord]:
        """Finished runs, in the order of the plan's methods, then by run. Raises StoreError if there is no such
        study."""
        with self._read() as connection:
            return self._runs(connection, self._row(connection, study_id))

    def whole(self, study_id: int) -> WholeStudy:
        """A study with its runs, tasks and checkpoints, all of one moment."""
        with self._read() as connection:
            row = self._row(connection, study_id)
            study, runs = self._study(connection, row), self._runs(connection, row)
            return WholeStudy(study, row.probe, task_records(connection, study_id), tuple(runs))

    def export_json(self, study_id: int, path: str | os.PathLike[str]) -> None:
        """The whole study as one JSON file that `import_file` brings back bit for bit; raises StoreError."""
        write_json(self.whole(study_id), Path(path))

    def export_parquet(self, study_id: int, path: str | os.PathLike[str]) -> None:
        """The same as Parquet: one row per run, one column per parameter, histories as lists; the study in the
        metadata."""
        write_parquet(self.whole(study_id), Path(path))

    def import_file(self, path: str | os.PathLike[str], *, spec_path: str | None = None) -> int:
        """Add the study of an exported file, finished or not; returns its id here. Raises StoreError if the file is
        not whole."""
        return self.add_whole(read_study(Path(path)), spec_path=spec_path)

    def add_whole(self, whole: WholeStudy, *, spec_path: str | None = None) -> int:
        """Add a study from elsewhere as a new one; `spec_path` is where its study file lies here, for the recordings
        beside it."""
        if spec_path is not None:
            whole = replace(whole, study=replace(whole.study, spec_path=spec_path))
        with self._write() as connection:
            return insert_whole(connection, whole)

    def find_same(self, whole: WholeStudy) -> int | None:
        """The study here with the same plan, spec and problem, or None."""
        with self._read() as connection:
            return find_same(connection, whole)

    def merge(self, whole: WholeStudy, origin: str) -> Merged:
        """Unite a study from elsewhere with the same one here, or add it if there is none, in one transaction.

        Runs that both have are compared bit for bit (seconds apart) and the ones here stay. What came
        from where is noted in the study; `origin` names the place.
        """
        with self._write() as connection:
            one_at_a_time(connection)
            return merge(connection, whole, origin)

    # what finishing found

    def finish_of(self, study_id: int, key: str) -> Any:
        """What `keep_finish` kept of a study under this key; None where there is nothing, or nothing that can be
        read."""
        kept = tables.finish
        with suppress(StoreError), self._read() as connection:
            if inspect(connection).has_table(kept.name):
                return connection.scalar(select(kept.c.content).where(kept.c.study == study_id, kept.c.key == key))
        return None

    def keep_finish(self, study_id: int, key: str, content: bytes) -> None:
        """Keep what finishing found, in place of what was kept of this study; nothing where this database cannot be
        written."""
        kept = tables.finish
        with suppress(StoreError), self._write() as connection:
            kept.create(connection, checkfirst=True)
            connection.execute(delete(kept).where(kept.c.study == study_id))
            connection.execute(insert(kept).values(study=study_id, key=key, content=content))

    # tasks, for workers

    def claim(self, study_id: int, worker: str) -> Claim | None:
        """The next free task, now held by `worker`, or None when all are done or held."""
        with self._write() as connection:
            self._row(connection, study_id, lock=EXISTENCE)
            return claims.take(connection, study_id, worker, self._now())

    def beat(self, claim: Claim, evaluations: float | None = None) -> None:
        """Say that the holder lives, and how many evaluations its runs have spent; ClaimLost if it was taken over."""
        told = {} if evaluations is None else {"evaluations": float(evaluations)}
        with self._write() as connection:
            claims.change(connection, claim, heartbeat=self._now(), **told)

    def held(self, study_id: int) -> list[Held]:
        """What live workers do now: the tasks they hold, in the order of the tasks."""
        with self._read() as connection:
            self._row(connection, study_id)
            return claims.held(connection, study_id, self._now())

    def save_checkpoint(self, claim: Claim, checkpoint: bytes) -> None:
        """Keep where the task stands; ClaimLost if it was taken over."""
        with self._write() as connection:
            claims.change(connection, claim, checkpoint=checkpoint, heartbeat=self._now())

    def release(self, claim: Claim, checkpoint: bytes | None = None) -> None:
        """Give the task back, open, with its newest checkpoint; ClaimLost if it was taken over."""
        newest = {} if checkpoint is None else {"checkpoint": checkpoint}
        with self._write() as connection:
            claims.change(connection, claim, claimed_by=None, heartbeat=None, evaluations=None, **newest)

    def finish(self, claim: Claim, results: Sequence["RunResult"], parameters: Sequence[dict[str, float]]) -> None:
        """Write the task's runs and mark it done, both or neither; ClaimLost if it was taken over."""
        rows = [run_row(claim.study, result, values) for result, values in zip(results, parameters, strict=True)]
        with self._write() as connection:
            claims.change(
                connection, claim, state="done", checkpoint=None, claimed_by=None, heartbeat=None, evaluations=None
            )
            if rows:
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
    def _transaction(self, engine: Engine) -> Generator[Connection]:
        with translated(self.name, self._address), engine.begin() as connection:
            yield connection

    def _read(self):
        return self._transaction(self._reader)

    def _write(self):
        return self._transaction(self._writer)

    def _now(self) -> float:
        return time.time() + self._clock_ahead

    def _row(self, connection: Connection, study_id: int, lock: Mapping[str, Any] | None = None) -> Row:
        query = select(tables.study).where(tables.study.c.id == study_id)
        row = connection.execute(query if lock is None else query.with_for_update(**lock)).one_or_none()
        if row is None:
            known = list(connection.scalars(select(tables.study.c.id).order_by(tables.study.c.id)))
            has = f"it has the studies {known}" if known else "it has none"
            raise StoreError(f"Study database {self.name} has no study {study_id!r}; {has}.")
        return row

    def _study(self, connection: Connection, row: Row) -> StudyRecord:
        runs = connection.scalar(select(func.count()).where(tables.run.c.study == row.id)) or 0
        with readable(self.name, row.id):
            return study_record(row, claims.is_held(connection, row.id, self._now()), runs)

    def _runs(self, connection: Connection, row: Row) -> list[RunRecord]:
        with readable(self.name, row.id):
            return run_records(connection, row)
