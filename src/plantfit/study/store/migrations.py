"""Schema versions: a new database gets the tables, an older one is brought forward step by step."""

from collections.abc import Callable
from datetime import UTC, datetime

from sqlalchemy import Connection, func, insert, inspect, select

from plantfit.errors import StoreError
from plantfit.study.store import tables
from plantfit.study.store.database_engine import one_at_a_time

Migration = Callable[[Connection], None]


def _second(connection: Connection) -> None:
    """Histories in less room, costs with every bit, how far a task in work has come."""
    blob = "BYTEA" if connection.dialect.name == "postgresql" else "BLOB"
    connection.exec_driver_sql("ALTER TABLE run ADD COLUMN packing INTEGER DEFAULT 0 NOT NULL")
    connection.exec_driver_sql(f"ALTER TABLE run ADD COLUMN cost_bits {blob}")
    connection.exec_driver_sql("ALTER TABLE task ADD COLUMN evaluations DOUBLE PRECISION")


# MIGRATIONS[k] brings a database from version k + 1 to k + 2; append, never edit
MIGRATIONS: tuple[Migration, ...] = (_second,)
VERSION = 1 + len(MIGRATIONS)


def migrate(connection: Connection, name: str, migrations: tuple[Migration, ...] = MIGRATIONS) -> int:
    """Bring the database to the newest version within the caller's transaction; returns that version.

    An empty database gets the tables as they are now. Raises StoreError for a database of a newer
    plantfit or of another program.
    """
    one_at_a_time(connection)
    version, newest = current_version(connection, name), 1 + len(migrations)
    if version > newest:
        raise StoreError(
            f"Study database {name} has schema version {version}, but this plantfit knows versions up to {newest}; "
            "update plantfit to open it."
        )
    if version == 0:
        tables.metadata.create_all(connection, tables=tables.OF_SCHEMA)
        later = migrations[VERSION - 1 :]
    else:
        later = migrations[version - 1 :]
    for step in later:
        step(connection)
    now = datetime.now(UTC).isoformat()
    for number in range(version + 1, newest + 1):
        connection.execute(insert(tables.schema_version).values(version=number, applied=now))
    return newest


def current_version(connection: Connection, name: str) -> int:
    """Newest applied version, 0 for an empty database; StoreError if it is no study database."""
    present = inspect(connection).get_table_names()
    if tables.schema_version.name in present:
        return connection.scalar(select(func.max(tables.schema_version.c.version))) or 0
    if present:
        raise StoreError(
            f"{name} is a database of another program (it has a table "
            f"{present[0]!r}); choose another one for the study."
        )
    return 0
