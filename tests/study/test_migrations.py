import sqlite3

import pytest
from sqlalchemy import create_engine, inspect

from plantfit.errors import StoreError
from plantfit.study import Store
from plantfit.study.migrations import MIGRATIONS, VERSION, current_version, migrate


def test_a_new_store_has_the_newest_version_and_opening_again_changes_nothing(tmp_path):
    Store.open(tmp_path / "s.db")
    Store.open(tmp_path / "s.db")
    with sqlite3.connect(tmp_path / "s.db") as connection:
        assert [row[0] for row in connection.execute("SELECT version FROM schema_version")] == list(range(1, VERSION + 1))
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_an_older_database_is_brought_forward_once(tmp_path):
    engine = create_engine(f"sqlite:///{tmp_path}/s.db")

    def add_column(connection):
        connection.exec_driver_sql("ALTER TABLE study ADD COLUMN colour TEXT")

    later = (*MIGRATIONS, add_column)
    for migrations in (MIGRATIONS, later, later):
        with engine.begin() as connection:
            assert migrate(connection, "s.db", migrations) == len(migrations)
    with engine.begin() as connection:
        assert current_version(connection, "s.db") == VERSION + 1
        assert "colour" in {column["name"] for column in inspect(connection).get_columns("study")}


def test_a_newer_database_is_refused(tmp_path):
    Store.open(tmp_path / "s.db")
    with sqlite3.connect(tmp_path / "s.db") as connection:
        connection.execute("INSERT INTO schema_version VALUES (?, '2040-01-01')", (VERSION + 1,))
    with pytest.raises(StoreError, match=rf"s\.db has schema version {VERSION + 1}.*update plantfit"):
        Store.open(tmp_path / "s.db")
