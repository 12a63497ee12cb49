"""A study as one JSON file or one Parquet table, written whole or not at all."""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import polars as pl

from plantfit.errors import StoreError
from plantfit.study.codec import plain, strict, to_json
from plantfit.study.records import RunRecord, StudyRecord

FORMAT = "plantfit study 1"


def write_json(study: StudyRecord, runs: Sequence[RunRecord], path: Path) -> None:
    """`{"format", "study", "runs"}`; raises StoreError if the file cannot be written."""
    record = {"format": FORMAT, "study": plain(asdict(study)), "runs": [plain(asdict(r)) for r in runs]}
    text = json.dumps(strict(record), ensure_ascii=False, indent=1, allow_nan=False)
    _whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_parquet(study: StudyRecord, runs: Sequence[RunRecord], path: Path) -> None:
    """One row per run; the study record stands in the file's metadata under "plantfit"."""
    columns: dict[str, Any] = {name: [getattr(r, name) for r in runs] for name in ("method", "run", "seed", "cost")}
    columns |= {"status": [r.status.value for r in runs]}
    columns |= {name: [getattr(r, name) for r in runs] for name in ("evaluations", "seconds", "failures")}
    columns |= {f"parameter {name}": [r.parameters[name] for r in runs] for name in study.coordinates}
    for name in ("x", "history_evaluations", "history_cost"):
        columns[name] = pl.Series([getattr(r, name).tolist() for r in runs], dtype=pl.List(pl.Float64))
    columns["extra"] = [to_json(r.extra) for r in runs]
    frame = pl.DataFrame(columns)
    _whole(path, lambda temporary: frame.write_parquet(temporary, metadata={"plantfit": to_json(asdict(study))}))


def _whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the target and move it there, so that a reader never sees half a file."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(temporary)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise StoreError(
            f"The study cannot be written to {path} ({error.strerror or error}); check the folder, its rights and free space."
        ) from error
