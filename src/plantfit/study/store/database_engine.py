"""Connections to the database: SQLite in WAL mode from a path, PostgreSQL by SQLAlchemy URL.

Both give every transaction of the store the same meaning. A reader sees one moment. Writers that
touch the same rows go one after another: SQLite has one writer at a time, PostgreSQL locks rows
where a statement says FOR UPDATE and runs every other statement on what is committed by then.
"""

import os
import sqlite3
import time
from importlib.util import find_spec
from pathlib import Path

from sqlalchemy import URL, Connection, Engine, create_engine, event, func, make_url, select
from sqlalchemy.engine.interfaces import DBAPICursor
from sqlalchemy.exc import ArgumentError
from sqlalchemy.pool import NullPool

from plantfit.errors import MissingExtra, StoreError
from plantfit.study.store.addresses import shown
from plantfit.study.store.database_failures import translated

WRITES = "plantfit_writes"
CONNECT_SECONDS = 10
MIGRATION_LOCK = 0x706C616E74666974  # "plantfit": any number that other programs do not use
RETRY_SECONDS = 0.02
# a server that vanished is noticed within a minute, not after the two hours of TCP
KEEPALIVE = {"keepalives_idle": 20, "keepalives_interval": 10, "keepalives_count": 3, "tcp_user_timeout": 60_000}


def connect(place: str | os.PathLike[str], busy_timeout: float, create: bool) -> tuple[Engine, str]:
    """An engine and the name to call it in messages. Raises StoreError and MissingExtra."""
    url = _url(place)
    backend = url.get_backend_name()
    if backend == "postgresql":
        return _server(url, busy_timeout)
    if backend != "sqlite":
        raise StoreError(
            f"Studies are kept in SQLite or PostgreSQL, not in {backend!r}; "
            "write a file name or postgresql+psycopg://user@host/name."
        )
    name = url.database or ""
    _check_path(Path(name), name, create)
    arguments = {"timeout": busy_timeout, "check_same_thread": False}
    if _is_read_only(Path(name)):
        place = _read_only_place(Path(name))
        engine = create_engine(
            "sqlite://", poolclass=NullPool, creator=lambda: sqlite3.connect(place, uri=True, **arguments)
        )
        _prepare_sqlite(engine, busy_timeout)
        return engine, name
    engine = create_engine(url, poolclass=NullPool, connect_args=arguments)
    _prepare_sqlite(engine, busy_timeout)
    with translated(name):
        _use_wal(engine, busy_timeout)
    return engine, name


def readers(engine: Engine) -> Engine:
    """The engine for transactions that only read, each one moment of the database."""
    if engine.dialect.name == "postgresql":
        return engine.execution_options(isolation_level="REPEATABLE READ")
    return engine


def writers(engine: Engine) -> Engine:
    """The engine for transactions that write."""
    return engine.execution_options(**{WRITES: True})


def one_at_a_time(connection: Connection) -> None:
    """Until the transaction ends no other process is past this line; SQLite has one writer anyway."""
    if connection.dialect.name == "postgresql":
        connection.execute(select(func.pg_advisory_xact_lock(MIGRATION_LOCK)))


def clock_ahead(connection: Connection, now: float) -> float:
    """Seconds that the clock of the server is ahead of `now`, so that all machines judge heartbeats by one clock."""
    if connection.dialect.name != "postgresql":
        return 0.0
    return float(connection.scalar(select(func.extract("epoch", func.clock_timestamp()))) or now) - now


def _url(place: str | os.PathLike[str]) -> URL:
    text = os.fspath(place)
    if "://" not in text:
        return URL.create("sqlite", database=text)
    try:
        return make_url(text)
    except (ArgumentError, ValueError):  # without the cause, which repeats the address
        raise StoreError(
            f"The study database address {shown(text)!r} cannot be read; "
            "write a file name or postgresql+psycopg://user@host/name."
        ) from None


def _server(url: URL, busy_timeout: float) -> tuple[Engine, str]:
    if find_spec("psycopg") is None:
        raise MissingExtra(
            "Keeping studies in PostgreSQL needs the package psycopg; install it with: pip install 'plantfit[postgres]'"
        )
    url = url.set(drivername="postgresql+psycopg")
    arguments = {"connect_timeout": CONNECT_SECONDS, **KEEPALIVE}
    arguments = {key: value for key, value in arguments.items() if key not in url.query}
    # one connection stays open in each process, and no thread ever waits for one
    engine = create_engine(url, pool_pre_ping=True, pool_size=1, max_overflow=-1, connect_args=arguments)

    @event.listens_for(engine, "begin")
    def _on_begin(connection) -> None:
        if connection.get_execution_options().get(WRITES, False):
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = {int(1000 * busy_timeout)}")

    return engine, shown(url.render_as_string(hide_password=False))


def _check_path(path: Path, name: str, create: bool) -> None:
    if name in ("", ":memory:"):
        raise StoreError(
            "A study database must outlive the process; give a file name in place of an in-memory database."
        )
    if path.is_dir():
        raise StoreError(f"Study database {name} is a folder; give the name of a file in it.")
    if not path.parent.is_dir():
        raise StoreError(
            f"Study database {name} cannot be made because the folder "
            f"{path.parent} does not exist; make the folder first."
        )
    if not create and not path.exists():
        raise StoreError(f"Study database {name} does not exist; check the name, or start a study to make it.")


def _is_read_only(path: Path) -> bool:
    """Whether a database is in a folder where SQLite cannot make its files for several readers, as on a read-only
    mount."""
    return path.exists() and not os.access(path.parent, os.W_OK)


def _read_only_place(path: Path) -> str:
    """The database as one that nobody changes, unless a log beside it holds changes that have to be read with it."""
    log = path.with_name(f"{path.name}-wal")
    held = "" if log.exists() and log.stat().st_size else "&immutable=1"
    return f"{path.resolve().as_uri()}?mode=ro{held}"


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


def _use_wal(engine: Engine, busy_timeout: float) -> None:
    """A log of writes beside the database, kept there for all who open it.

    SQLite does not wait by itself for this one change: of two who make it at once, one is told at once that the
    database is locked (the second step of a transaction that has begun, sqlite3BtreeBeginTrans).
    """
    raw, until = engine.raw_connection(), time.monotonic() + busy_timeout
    try:
        while not _is_wal(raw.cursor(), until):
            time.sleep(RETRY_SECONDS)
    finally:
        raw.close()


def _is_wal(cursor: DBAPICursor, until: float) -> bool:
    """Whether the database keeps a log now; False where another one holds it and there is time to try again."""
    try:
        cursor.execute("PRAGMA journal_mode")
        if cursor.fetchone() != ("wal",):
            cursor.execute("PRAGMA journal_mode = WAL")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() >= until:
            raise
        return False
    return True
