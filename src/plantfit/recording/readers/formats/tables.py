"""Parquet files, spreadsheets and data frames."""

import os
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import polars as pl

from plantfit.errors import MissingExtra, RecordingError
from plantfit.recording.readers.assemble import Options, assemble
from plantfit.recording.readers.clock import is_time_name
from plantfit.recording.readers.columns import Column, Table, cells_of, named_columns
from plantfit.recording.readers.files import existing
from plantfit.recording.readers.formats.text.header import above_the_table, headings, is_header, unique, unit_row
from plantfit.recording.readers.tried import check
from plantfit.recording.record import Recording


def read_parquet(path: str | os.PathLike[str], **options: Unpack[Options]) -> Recording:
    """A recording from a Parquet file; `options` as for `read_csv`. Raises RecordingError and UnitError."""
    return assemble(parquet_table(path), **options)


def read_xlsx(path: str | os.PathLike[str], *, sheet: str | int = 0, **options: Unpack[Options]) -> Recording:
    """A recording from one sheet (name, or number from 0) of a spreadsheet; `options` as for `read_csv`.

    Raises MissingExtra when fastexcel is not installed.
    """
    return assemble(xlsx_table(path, sheet=sheet), **options)


def from_frame(frame: Any, **options: Unpack[Options]) -> Recording:
    """A recording from a polars or pandas data frame; `options` as for `read_csv`.

    The index of a pandas frame is a column like the others where it can be the time: it holds dates or durations, has a
    name such as "t" or "time [ms]", or the name that `time` gives. Raises RecordingError and UnitError.
    """
    return assemble(frame_table(frame, "data frame", options.get("time")), **options)


def parquet_table(path: str | os.PathLike[str]) -> Table:
    """The columns of a Parquet file, not yet interpreted."""
    file = existing(path)
    check("parquet", file)
    try:
        frame = pl.read_parquet(file)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise RecordingError(
            f"{file.name} cannot be read as Parquet ({str(error).splitlines()[0]}); write it anew."
        ) from None
    return frame_table(frame, file.name)


def frame_table(frame: Any, source: str, time: str | int | None = None) -> Table:
    """The columns of a data frame, of which only `columns`, `[name].to_numpy()` and, if there is one, `index` are
    asked."""
    if not isinstance(frame, pl.DataFrame):
        if not hasattr(frame, "columns") or not hasattr(frame, "__getitem__"):
            raise RecordingError(
                f"A {type(frame).__name__} is not a data frame; give a polars or pandas frame, or use from_arrays."
            )
        arrays = {str(name): np.asarray(frame[name].to_numpy()) for name in frame.columns}
        cells = [cells_of(name, array) for name, array in arrays.items()]
        columns = (*named_columns(arrays, cells), *_index(frame, time, list(arrays)))  # numbers of columns stay
        return Table(source, columns, log=(f"Read from {source}.",))
    return Table(source, named_columns(frame.columns, frame.get_columns()), log=(f"Read from {source}.",))


def _index(frame: Any, time: str | int | None, taken: list[str]) -> tuple[Column, ...]:
    """The index of a pandas frame as a column, where it can be the time."""
    index = getattr(frame, "index", None)
    if index is None or callable(index) or not hasattr(index, "to_numpy"):
        return ()
    array, name = np.asarray(index.to_numpy()), str(getattr(index, "name", None) or "t")
    named = getattr(index, "name", None) is not None
    (column,) = named_columns([name], [cells_of(name, array)])
    can_be = column.cells.dtype.is_temporal() or (
        named and (str(time) in (name, column.name) or is_time_name(column.name))
    )
    return (column,) if can_be and name not in taken else ()


def xlsx_table(path: str | os.PathLike[str], *, sheet: str | int = 0) -> Table:
    """The columns of one sheet, not yet interpreted."""
    file = existing(path)
    try:
        import fastexcel
    except ImportError:
        raise MissingExtra(
            f"Reading {file.name} needs the package fastexcel; install it with: pip install 'plantfit[xlsx]'"
        ) from None
    try:
        book = fastexcel.read_excel(file)
    except fastexcel.FastExcelError as error:
        raise RecordingError(
            f"{file.name} cannot be read as a spreadsheet ({str(error).splitlines()[0]}); save it anew as .xlsx."
        ) from None
    names = book.sheet_names
    if (isinstance(sheet, int) and not 0 <= sheet < len(names)) or (isinstance(sheet, str) and sheet not in names):
        raise RecordingError(f"{file.name} has no sheet {sheet!r}; it has {names}.")
    return _sheet_table(file, book, sheet)


def _sheet_table(file: Path, book: Any, sheet: str | int) -> Table:
    # as text for the headings only: text of numbers is rounded
    text = book.load_sheet(sheet, header_row=None, skip_rows=0, dtypes="string", n_rows=50).to_polars()
    filled = [i for i, row in enumerate(text.iter_rows()) if any(row)]
    if not filled:
        raise RecordingError(f"{file.name}, sheet {sheet!r} holds no rows of data; choose another with sheet=.")
    texts = [[cell or "" for cell in text.row(i)] for i in filled]
    above = above_the_table(texts)
    first, filled = filled[above], filled[above:]
    rows = texts[above : above + 2]
    named = is_header(rows[0])
    units = unit_row(rows[1]) if named and len(rows) > 1 else None
    start = first if not named else (filled[1] + 1 if units else first + 1)
    try:
        frame = book.load_sheet(sheet, header_row=None, skip_rows=start).to_polars()
    except Exception as error:  # fastexcel says "no data" in several ways
        raise RecordingError(
            f"{file.name}, sheet {sheet!r} holds no rows of data ({str(error).splitlines()[0]}); choose another."
        ) from None
    places = np.arange(len(frame)) + start + 1
    there = frame.select(pl.any_horizontal(pl.all().is_not_null())).to_series().to_numpy()
    frame, places = frame.filter(there), places[there]
    columns = named_columns(unique(rows[0]) if named else headings(frame.width), frame.get_columns(), units)
    columns = tuple(
        c
        for c, head in zip(columns, rows[0], strict=True)
        if not (named and not head and c.cells.null_count() == len(c.cells))
    )
    log = [f"Read from {file.name}, sheet {book.sheet_names[sheet] if isinstance(sheet, int) else sheet!r}."]
    return Table(file.name, columns, places, "row", "auto", named, tuple(log))
