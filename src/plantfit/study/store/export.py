"""A whole study as one JSON or Parquet file, every bit of it, written whole or not at all.

Both hold the same: a header (format, study, probe, tasks with their checkpoints) and the runs. In
JSON the header comes first and each run has a line; in Parquet each run is a row and the header is
the file's metadata under "plantfit". What belongs to one database only, ids and claims, is left out.
"""

import json
import os
from base64 import b64encode
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from plantfit.errors import StoreError
from plantfit.study.store.codec import exact_tree, spelled, to_json
from plantfit.study.store.records import RunRecord, StudyRecord, TaskRecord, WholeStudy

FORMAT = "plantfit study 2"
NUMBERS = ("cost", "evaluations", "seconds")
WHOLE_NUMBERS = ("run", "seed", "failures")
VECTORS = ("x", "history_evaluations", "history_cost")
PARAMETER = "parameter "  # what the column of a parameter begins with


def write_json(whole: WholeStudy, path: Path) -> None:
    """One JSON value; not-finite floats are text such as "NaN". Raises StoreError if the file cannot be written."""

    def write(temporary: Path) -> None:
        with temporary.open("w", encoding="utf-8") as file:
            file.write(_text(header(whole))[:-1] + ',\n"runs": [')
            for k, run in enumerate(whole.runs):
                file.write((",\n" if k else "\n") + _text(_run(run)))
            file.write("\n]}\n")

    _whole(path, write)


def write_parquet(whole: WholeStudy, path: Path) -> None:
    """One row per run; the header as JSON text in the file's metadata under "plantfit"."""
    runs = whole.runs
    columns = [
        pl.Series("method", [r.method for r in runs], pl.String),
        *(pl.Series(name, [getattr(r, name) for r in runs], pl.Int64) for name in WHOLE_NUMBERS),
        pl.Series("status", [r.status.value for r in runs], pl.String),
        *(pl.Series(name, [getattr(r, name) for r in runs], pl.Float64) for name in NUMBERS),
        *(
            pl.Series(PARAMETER + name, [r.parameters.get(name) for r in runs], pl.Float64)
            for name in _parameters(whole)
        ),
        *(pl.Series(name, [getattr(r, name).tolist() for r in runs], pl.List(pl.Float64)) for name in VECTORS),
        pl.Series("extra", [to_json(r.extra) for r in runs], pl.String),
    ]
    frame = pl.DataFrame(columns)
    _whole(path, lambda temporary: frame.write_parquet(temporary, metadata={"plantfit": _text(header(whole))}))


def header(whole: WholeStudy) -> dict[str, Any]:
    """All but the runs, as JSON types."""
    return {
        "format": FORMAT,
        "study": _study(whole.study),
        "probe": b64encode(whole.probe).decode(),
        "tasks": [_task(t) for t in whole.tasks],
    }


def _study(study: StudyRecord) -> dict[str, Any]:
    return {
        "name": study.name,
        "created": study.created,
        "plan": exact_tree(study.plan),
        "spec_text": study.spec_text,
        "spec_path": study.spec_path,
        "coordinates": list(study.coordinates),
        "versions": dict(study.versions),
        "cpu": study.cpu,
        "notes": list(study.notes),
        "runs_done": study.runs_done,
        "runs_total": study.runs_total,
    }


def _task(task: TaskRecord) -> dict[str, Any]:
    checkpoint = None if task.checkpoint is None else b64encode(task.checkpoint).decode()
    return {
        "method": task.method,
        "first": task.first,
        "count": task.count,
        "done": task.done,
        "checkpoint": checkpoint,
    }


def _run(run: RunRecord) -> dict[str, Any]:
    return {
        "method": run.method,
        **{name: getattr(run, name) for name in WHOLE_NUMBERS},
        "status": run.status.value,
        **{name: spelled(getattr(run, name)) for name in NUMBERS},
        "parameters": {name: spelled(value) for name, value in run.parameters.items()},
        **{name: [spelled(v) for v in getattr(run, name).tolist()] for name in VECTORS},
        "extra": exact_tree(run.extra),
    }


def _parameters(whole: WholeStudy) -> Sequence[str]:
    """The coordinates that have values in some run; all of them where there is no run yet."""
    return [name for name in whole.study.coordinates if not whole.runs or any(name in r.parameters for r in whole.runs)]


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the target and move it there, so that a reader never sees half a file."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            write(temporary)
            with temporary.open("rb+") as written:  # on the disk before it takes the place of an older file
                os.fsync(written.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise StoreError(
            f"The study cannot be written to {path} ({error.strerror or error}); "
            "check the folder, its rights and free space."
        ) from error
