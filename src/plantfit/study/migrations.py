"""Schema versions: a new database gets the tables, an older one is brought forward step by step."""

from collections.abc import Callable
from datetime import UTC, datetime

from sqlalchemy import Connection, func, insert, inspect, select

from plantfit.errors import StoreError
from plantfit.study import tables

Migration = Callable[[Connection], None]


def _create(connection: Connection) -> None:
    tables.metadata.create_all(connection)


# MIGRATIONS[v] brings a database from version v to v + 1; append, never edit
MIGRATIONS: tuple[Migration, ...] = (_create,)
VERSION = len(MIGRATIONS)


def migrate(connection: Connection, name: str, migrations: tuple[Migration, ...] = MIGRATIONS) -> int:
    """Bring the database to the newest version within the caller's transaction; returns that version.

    Raises StoreError for a database of a newer plantfit or of another program.
    """
    version = current_version(connection, name)
    if version > len(migrations):
        raise StoreError(
            f"Study database {name} has schema version {version}, but this plantfit knows versions up to {len(migrations)}; "
            "update plantfit to open it."
        )
    for number in range(version, len(migrations)):
        migrations[number](connection)
        connection.execute(insert(tables.schema_version).values(version=number + 1, applied=datetime.now(UTC).isoformat()))
    return len(migrations)


def current_version(connection: Connection, name: str) -> int:
    """Newest applied version, 0 for an empty database; StoreError if it is no study database."""
    present = inspect(connection).get_table_names()
    if tables.schema_version.name in present:
        return connection.scalar(select(func.max(tables.schema_version.c.version))) or 0
    if present:
        raise StoreError(f"{name} is a database of another program (it has a table {present[0]!r}); choose another file for the study.")
    return 0
