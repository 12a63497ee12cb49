"""One reader for all formats, chosen by the ending of the file name; other packages may bring more (`plugins.py`)."""

import os
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.errors import PlantfitError, RecordingError
from plantfit.plugins import Plugin, offered
from plantfit.recording.readers.assemble import assemble
from plantfit.recording.readers.columns import Table
from plantfit.recording.readers.files import existing
from plantfit.recording.readers.formats.arrays import array_table, mat_table, npz_table, read_mat, read_npz
from plantfit.recording.readers.formats.tables import parquet_table, read_parquet, read_xlsx, xlsx_table
from plantfit.recording.readers.formats.text.csv import csv_table, read_csv
from plantfit.recording.readers.memory import free_memory, memory_needed
from plantfit.recording.readers.panics import unheard
from plantfit.recording.record import Recording

TEXT = (".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc", ".log")
_READERS: dict[str, tuple[Callable[..., Recording], Callable[..., Table], tuple[str, ...]]] = {
    **dict.fromkeys(TEXT, (read_csv, csv_table, ("delimiter", "decimal", "header", "skip"))),
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), (read_xlsx, xlsx_table, ("sheet",))),
    ".parquet": (read_parquet, parquet_table, ()),
    ".mat": (read_mat, mat_table, ()),
    ".npz": (read_npz, npz_table, ()),
}

_OWN = tuple(ending[1:] for ending in _READERS)


def _entry(path: str | os.PathLike[str]):
    file = existing(path)
    suffix = Path(file.stem).suffix.lower() if file.suffix.lower() == ".gz" else file.suffix.lower()
    if suffix in TEXT or (suffix in _READERS and file.suffix.lower() != ".gz"):
        return suffix, _READERS[suffix]
    brought = offered("readers", frozenset(_OWN))
    if suffix[1:] not in brought or file.suffix.lower() == ".gz":
        known = sorted([*_READERS, *(f".{name}" for name in brought)])
        raise RecordingError(
            f"{file.name}: no reader for files ending in {suffix!r}; known are {known} and text with .gz."
        )
    return suffix, _brought(brought[suffix[1:]])


def _brought(plugin: Plugin) -> tuple[Callable[..., Recording], Callable[..., Table], tuple[str, ...]]:
    """A reader of another package: a function of the path that gives named arrays, one may be "time"; names may hold
    units in []."""

    def table(path: str | os.PathLike[str], time: str | int | None = None) -> Table:
        arrays = plugin.load(RecordingError)(existing(path))
        if not isinstance(arrays, Mapping):
            raise RecordingError(
                f"{Path(path).name}: the reader {plugin.name!r} of the package {plugin.package} gave a "
                f"{type(arrays).__name__}; "
                "it has to give a mapping of names to arrays."
            )
        return array_table(Path(path).name, {str(name): np.asarray(values) for name, values in arrays.items()}, time)

    def recording(path: str | os.PathLike[str], **options: Any) -> Recording:
        return assemble(table(path, options.get("time")), **options)

    return recording, table, ()


def read(path: str | os.PathLike[str], **options: Any) -> Recording:
    """A recording from any file with a known ending; `options` are those of the reader for it.

    Raises RecordingError for an unknown ending and for options of another format.
    """
    suffix, (reader, _, own) = _entry(path)
    foreign = {name for _, _, names in _READERS.values() for name in names} - set(own)
    wrong = sorted(foreign & set(options))
    if wrong:
        raise RecordingError(f"{Path(path).name}: option {wrong[0]!r} does not apply to {suffix} files; leave it out.")
    with _of(path):
        return reader(path, **options)


def table(path: str | os.PathLike[str], **options: Any) -> Table:
    """The columns of any file with a known ending, not yet interpreted."""
    _, (_, reader, _) = _entry(path)
    with _of(path):
        return reader(path, **options)


@contextmanager
def _of(path: str | os.PathLike[str]) -> Generator[None]:
    """Refuse a file that the memory cannot hold, and say whatever a parser could not do with it as RecordingError."""
    name = Path(path).name
    needed, free = memory_needed(Path(path)), free_memory()
    if free is not None and needed > free:
        raise RecordingError(
            f"{name}: reading it needs about {needed / 2**30:.1f} GiB of memory and {free / 2**30:.1f} GiB are free; "
            "cut the file into parts, or keep only the columns that are used."
        )
    try:
        with unheard():
            yield
    except (PlantfitError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except MemoryError as error:
        raise RecordingError(
            f"{name}: the memory of this machine is not enough to read it; cut the file into parts."
        ) from error
    except BaseException as error:  # parsers of broken files raise nearly everything, that of polars a BaseException
        first = (str(error).splitlines() or [""])[0][:200]
        told = (
            f"{name} cannot be read ({type(error).__name__}: {first}); check that the file is whole and of this kind."
        )
        raise RecordingError(told) from error
