import sqlite3
import struct

import numpy as np
import pytest
from postgres_server import libpq
from sqlalchemy import create_engine, inspect
from study_fakes import FakeSearch, fake_result, objective, to_physical
from test_study_runner import bits

from plantfit.errors import StoreError
from plantfit.study import Plan, Store, resume, run
from plantfit.study.running.probe import probe
from plantfit.study.store.codec import to_blob, to_json
from plantfit.study.store.migrations import MIGRATIONS, VERSION, current_version, migrate


def test_a_new_store_has_the_newest_version_and_opening_again_changes_nothing(tmp_path):
    Store.open(tmp_path / "s.db")
    Store.open(tmp_path / "s.db")
    with sqlite3.connect(tmp_path / "s.db") as connection:
        assert [row[0] for row in connection.execute("SELECT version FROM schema_version")] == list(
            range(1, VERSION + 1)
        )
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_an_older_database_is_brought_forward_once(tmp_path):
    engine = create_engine(f"sqlite:///{tmp_path}/s.db")

    def add_column(connection):
        connection.exec_driver_sql("ALTER TABLE study ADD COLUMN colour TEXT")

    later = (*MIGRATIONS, add_column)
    for migrations in (MIGRATIONS, later, later):
        with engine.begin() as connection:
            assert migrate(connection, "s.db", migrations) == 1 + len(migrations)
    with engine.begin() as connection:
        assert current_version(connection, "s.db") == VERSION + 1
        assert "colour" in {column["name"] for column in inspect(connection).get_columns("study")}


def test_a_newer_database_is_refused(tmp_path):
    Store.open(tmp_path / "s.db")
    with sqlite3.connect(tmp_path / "s.db") as connection:
        connection.execute("INSERT INTO schema_version VALUES (?, '2040-01-01')", (VERSION + 1,))
    with pytest.raises(StoreError, match=rf"s\.db has schema version {VERSION + 1}.*update plantfit"):
        Store.open(tmp_path / "s.db")


# what plantfit made when the schema had version 1
FIRST_SQLITE = """
CREATE TABLE schema_version (version INTEGER NOT NULL, applied TEXT NOT NULL, PRIMARY KEY (version));
CREATE TABLE study (
    id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, created TEXT NOT NULL, state TEXT NOT NULL, plan TEXT NOT NULL,
    spec TEXT, spec_path TEXT, coordinates TEXT NOT NULL, versions TEXT NOT NULL, cpu TEXT NOT NULL, notes TEXT NOT NULL,
    probe BLOB NOT NULL, CONSTRAINT study_state CHECK (state IN ('running', 'interrupted', 'done')));
CREATE TABLE task (
    id INTEGER NOT NULL, study INTEGER NOT NULL, method TEXT NOT NULL, first INTEGER NOT NULL, count INTEGER NOT NULL,
    state TEXT NOT NULL, checkpoint BLOB, claimed_by TEXT, heartbeat DOUBLE, updated TEXT NOT NULL, PRIMARY KEY (id),
    UNIQUE (study, method, first), CONSTRAINT task_state CHECK (state IN ('open', 'done')),
    FOREIGN KEY(study) REFERENCES study (id) ON DELETE CASCADE);
CREATE TABLE run (
    study INTEGER NOT NULL, method TEXT NOT NULL, run INTEGER NOT NULL, seed BIGINT NOT NULL, cost DOUBLE, x BLOB NOT NULL,
    parameters TEXT NOT NULL, evaluations DOUBLE NOT NULL, seconds DOUBLE NOT NULL, status TEXT NOT NULL, failures BIGINT NOT NULL,
    history_evaluations BLOB NOT NULL, history_cost BLOB NOT NULL, extra TEXT NOT NULL, PRIMARY KEY (study, method, run),
    FOREIGN KEY(study) REFERENCES study (id) ON DELETE CASCADE);
INSERT INTO schema_version VALUES (1, '2026-11-21T12:00:00+00:00');
"""  # noqa: E501
PLAN = Plan(name="old", methods=("random", "pso"), runs=3, budget=40, seed=4, chunk=2)
NAMES = ("x1", "x2", "x3")


def first_version(execute, mark):
    """A half-finished study in the tables of version 1: the first task is done, the second has a checkpoint."""

    def insert(table, *values):
        execute(f"INSERT INTO {table} VALUES ({', '.join([mark] * len(values))})", values)

    fingerprint = probe(objective(), to_physical)
    insert(
        "study", 1, "old", "2026-11-21T12:00:00+00:00", "interrupted", to_json(PLAN.record()), "spec", None,
        to_json(NAMES), "{}", "cpu",
        "[]", fingerprint,
    )  # fmt: skip
    for k, (method, first, count) in enumerate((("random", 0, 2), ("random", 2, 1), ("pso", 0, 2), ("pso", 2, 1))):
        insert(
            "task",
            k + 1,
            1,
            method,
            first,
            count,
            "done" if k == 0 else "open",
            b"[2]" if k == 1 else None,
            None,
            None,
            "then",
        )
    for k in range(2):
        r = fake_result(PLAN, "random", k)
        parameters = to_json(dict(zip(NAMES, np.asarray(to_physical(r.x)).tolist(), strict=True)))
        insert(
            "run", 1, "random", k, 4, r.cost, to_blob(r.x), parameters, r.evaluations, r.seconds, "budget", r.failures,
            to_blob(r.history_evaluations), to_blob(r.history_cost), to_json(r.extra),
        )  # fmt: skip


def old_sqlite(tmp_path):
    path = tmp_path / "old.db"
    connection = sqlite3.connect(path)
    connection.executescript(FIRST_SQLITE)
    first_version(connection.execute, "?")
    connection.commit()
    connection.close()
    return path


def old_postgres(place):
    import psycopg

    text = FIRST_SQLITE.replace("INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT", "SERIAL PRIMARY KEY").replace(
        "id INTEGER", "id SERIAL"
    )
    text = text.replace("BLOB", "BYTEA").replace("DOUBLE", "DOUBLE PRECISION")
    with psycopg.connect(libpq(place)) as connection:
        connection.execute(text)
        first_version(connection.execute, "%s")
        connection.execute("SELECT setval('study_id_seq', 1), setval('task_id_seq', 4)")
    return place


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_a_database_of_version_1_is_read_and_its_study_goes_on(backend, tmp_path, request, monkeypatch):
    place = old_sqlite(tmp_path) if backend == "sqlite" else old_postgres(request.getfixturevalue("postgres_url"))
    store, search = Store.open(place), FakeSearch()
    before = store.runs(1)
    assert [r.history_cost.tobytes() for r in before] == [
        fake_result(PLAN, "random", k).history_cost.tobytes() for k in range(2)
    ]
    with pytest.raises(StoreError, match="with edition 1 of the searches"):
        resume(store, 1, objective(), to_physical=to_physical, search=search)
    assert search.done == []
    monkeypatch.setattr("plantfit.study.running.runner.SEARCHES", 1)  # by the searches that it was begun with
    resume(store, 1, objective(), to_physical=to_physical, search=search)
    assert search.done == [("pso", k) for k in range(3)]  # run 2 of random was in the checkpoint
    once = Store.open(tmp_path / "once.db")
    run(PLAN, objective(), once, to_physical=to_physical, search=FakeSearch())
    assert bits(store.runs(1)) == bits(once.runs(1))
    assert store.runs(1)[0].cost == before[0].cost
    assert run(PLAN, objective(), store, to_physical=to_physical, search=search) == 2  # new ids go on from the old ones
    assert len(Store.open(place).runs(2)) == 6
    with store.engine.connect() as connection:
        assert current_version(connection, "old") == VERSION
        packed = (
            connection.exec_driver_sql("SELECT packing FROM run WHERE study = 1 ORDER BY method DESC, run")
            .scalars()
            .all()
        )
    assert packed == [0, 0, 1, 1, 1, 1]  # old blobs stay as they were


def test_new_and_migrated_databases_have_the_same_columns(tmp_path):
    def columns(store):
        return {
            t: {c["name"]: str(c["type"]) for c in inspect(store.engine).get_columns(t)}
            for t in inspect(store.engine).get_table_names()
        }

    old, new = columns(Store.open(old_sqlite(tmp_path))), columns(Store.open(tmp_path / "new.db"))
    assert {t: set(c) for t, c in old.items()} == {t: set(c) for t, c in new.items()}


def test_a_cost_of_version_1_without_bits(tmp_path):
    path = old_sqlite(tmp_path)
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE run SET cost = NULL WHERE run = 0")
    nan, cost = (r.cost for r in Store.open(path).runs(1))
    assert np.isnan(nan)
    assert struct.pack("<d", cost) == struct.pack("<d", fake_result(PLAN, "random", 1).cost)
