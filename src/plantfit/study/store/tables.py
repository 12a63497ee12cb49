"""The tables of a study database, schema version 2, in SQLite and PostgreSQL.

    schema_version      one row per migration that was applied
    study      1 --- n  task      chunks of runs, claimed by workers, with a checkpoint while they run
               1 --- n  run       finished runs, written in the transaction that marks their task done
               1 --- 1  finish    what finishing found for them (trust/finish/stored.py), made when there is something
               to keep

Table finish is no part of the schema's version: it holds nothing that could not be found anew. So older databases, also
those that cannot be written, and older plantfits do without it.

Vectors are blobs of little-endian float64 and trees are JSON text, so that every bit comes back; see codec.py.
"""

from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    Column,
    Double,
    ForeignKey,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
    text,
)

metadata = MetaData()

schema_version = Table(
    "schema_version",
    metadata,
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("applied", Text, nullable=False),  # UTC, ISO 8601
)

study = Table(
    "study",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("name", Text, nullable=False),
    Column("created", Text, nullable=False),  # UTC, ISO 8601
    Column("state", Text, nullable=False),
    Column("plan", Text, nullable=False),  # JSON
    Column("spec", Text),  # the study file as it was
    Column("spec_path", Text),  # where it was, for the recordings beside it
    Column("coordinates", Text, nullable=False),  # JSON list of names
    Column("versions", Text, nullable=False),  # JSON
    Column("cpu", Text, nullable=False),
    Column("notes", Text, nullable=False),  # JSON list of sentences
    Column("probe", LargeBinary, nullable=False),  # see probe.py
    CheckConstraint("state IN ('running', 'interrupted', 'done')", name="study_state"),
    sqlite_autoincrement=True,  # an id is never given twice
)

task = Table(
    "task",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("study", ForeignKey("study.id", ondelete="CASCADE"), nullable=False),
    Column("method", Text, nullable=False),
    Column("first", Integer, nullable=False),
    Column("count", Integer, nullable=False),
    Column("state", Text, nullable=False),
    Column("checkpoint", LargeBinary),
    Column("claimed_by", Text),
    Column("heartbeat", Double),  # seconds since 1970, UTC
    Column("evaluations", Double),  # of the runs in work, as the holder last said; since version 2
    Column("updated", Text, nullable=False),
    UniqueConstraint("study", "method", "first"),
    CheckConstraint("state IN ('open', 'done')", name="task_state"),
)

run = Table(
    "run",
    metadata,
    Column("study", ForeignKey("study.id", ondelete="CASCADE"), primary_key=True),
    Column("method", Text, primary_key=True),
    Column("run", Integer, primary_key=True, autoincrement=False),
    Column("seed", BigInteger, nullable=False),
    Column("cost", Double),  # NULL is NaN
    Column("cost_bits", LargeBinary),  # the same as float64: SQLite knows no -0.0; since version 2
    Column("x", LargeBinary, nullable=False),
    Column("parameters", Text, nullable=False),  # JSON, name to value in the declared unit
    Column("evaluations", Double, nullable=False),
    Column("seconds", Double, nullable=False),
    Column("status", Text, nullable=False),
    Column("failures", BigInteger, nullable=False),
    # of the histories, see codec.py; since version 2
    Column("packing", Integer, nullable=False, server_default=text("0")),
    Column("history_evaluations", LargeBinary, nullable=False),
    Column("history_cost", LargeBinary, nullable=False),
    Column("extra", Text, nullable=False),  # JSON
)

finish = Table(
    "finish",
    metadata,
    Column("study", ForeignKey("study.id", ondelete="CASCADE"), primary_key=True),
    Column("key", Text, nullable=False),  # a digest of all that it depends on
    Column("content", LargeBinary, nullable=False),
)
OF_SCHEMA = (schema_version, study, task, run)
