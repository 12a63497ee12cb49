"""Connections to the database: SQLite in WAL mode from a path, anything else by SQLAlchemy URL."""

import os
from pathlib import Path

from sqlalchemy import URL, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError
from sqlalchemy.pool import NullPool

from plantfit.errors import StoreError
from plantfit.study.failures import translated

WRITES = "plantfit_writes"


def connect(place: str | os.PathLike[str], busy_timeout: float, create: bool) -> tuple[Engine, str]:
    """An engine and the name to call it in messages. Raises StoreError."""
    url = _url(place)
    if url.get_backend_name() != "sqlite":
        return _server(url)
    name = url.database or ""
    _check_path(Path(name), name, create)
    engine = create_engine(url, poolclass=NullPool, connect_args={"timeout": busy_timeout, "check_same_thread": False})
    _prepare_sqlite(engine, busy_timeout)
    with translated(name):
        _use_wal(engine)
    return engine, name


def _url(place: str | os.PathLike[str]) -> URL:
    text = os.fspath(place)
    if "://" not in text:
        return URL.create("sqlite", database=text)
    try:
        return make_url(text)
    except ArgumentError as error:
        raise StoreError(f"The study database address {text!r} cannot be read; write a file name or dialect://user@host/name.") from error


def _server(url: URL) -> tuple[Engine, str]:
    name = url.render_as_string(hide_password=True)
    try:
        return create_engine(url, pool_pre_ping=True), name
    except (NoSuchModuleError, ModuleNotFoundError) as error:
        raise StoreError(f"Study database {name} needs a driver that is not installed ({error}); install it or use a file name.") from error


def _check_path(path: Path, name: str, create: bool) -> None:
    if name in ("", ":memory:"):
        raise StoreError("A study database must outlive the process; give a file name in place of an in-memory database.")
    if path.is_dir():
        raise StoreError(f"Study database {name} is a folder; give the name of a file in it.")
    if not path.parent.is_dir():
        raise StoreError(f"Study database {name} cannot be made because the folder {path.parent} does not exist; make the folder first.")
    if not create and not path.exists():
        raise StoreError(f"Study database {name} does not exist; check the name, or start a study to make it.")


def _prepare_sqlite(engine: Engine, busy_timeout: float) -> None:
    @event.listens_for(engine, "connect")
    def _on_connect(connection, _record) -> None:
        connection.isolation_level = None  # transactions are begun below, not by the driver
        connection.execute(f"PRAGMA busy_timeout = {int(1000 * busy_timeout)}")
        connection.execute("PRAGMA foreign_keys = ON")

    @event.listens_for(engine, "begin")
    def _on_begin(connection) -> None:
        # a writer takes its lock at once: a reader that turns writer could not wait for one
        immediate = connection.get_execution_options().get(WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if immediate else "BEGIN")


def _use_wal(engine: Engine) -> None:
    raw = engine.raw_connection()
    try:
        cursor = raw.cursor()
        cursor.execute("PRAGMA journal_mode")
        if cursor.fetchone() != ("wal",):
            cursor.execute("PRAGMA journal_mode = WAL")
    finally:
        raw.close()
