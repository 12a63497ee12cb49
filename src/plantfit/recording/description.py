"""What a file seems to hold, before anything is chosen."""

import os
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars as pl

from plantfit.errors import PlantfitError
from plantfit.recording.readers.any_format import table
from plantfit.recording.readers.clock import guess_time, seconds
from plantfit.recording.readers.columns import Column, Table, identifier
from plantfit.recording.readers.long_tables import widened
from plantfit.recording.readers.numbers import casted, clean_text, mostly_numbers
from plantfit.recording.readers.timestamps import Dates


@dataclass(frozen=True)
class ColumnSummary:
    """One column: `name` is fit for formulas; `texts` counts cells that are text; `first` shows cells as they stand."""

    header: str
    name: str
    unit: str | None
    kind: Literal["time", "number", "text"]
    missing: int
    texts: int
    minimum: float | None
    maximum: float | None
    first: tuple[str, ...]
    first_number: float | None = None


@dataclass(frozen=True)
class Description:
    """A file: columns, rows, the header of the likely time column, its usual step and jitter in seconds.

    `jitter` is the largest difference of a step from `period`. `problem` says why the time column
    cannot be used as it is, if so. `dates` is the order of day and month that was given for it.
    """

    file: str
    rows: int
    columns: tuple[ColumnSummary, ...]
    time: str | None
    period: float | None
    jitter: float | None
    problem: str | None
    log: tuple[str, ...]
    dates: Dates | None = None


def describe(path: str | os.PathLike[str], dates: Dates | None = None, **options: Any) -> Description:
    """Columns with names, units, kinds and ranges, and the likely time column; `options` as delimiter, sheet, ..."""
    return described(table(path, **options), dates)


def described(content: Table, dates: Dates | None = None) -> Description:
    """The same of columns that were read; `dates` says the order of day and month in time stamps."""
    found = widened(content)
    time = guess_time(found)
    period = jitter = problem = None
    if time is None and found.period is not None:
        period, jitter = found.period[1], 0.0
    if time is not None:
        try:
            steps = np.abs(np.diff(seconds(found, time, None, dates)[0]))  # the newest row may come first
            if len(steps):
                period = float(np.median(steps))
                jitter = float(np.max(np.abs(steps - period)))
        except PlantfitError as error:
            problem = str(error)
    rows = len(found.columns[0].cells) if found.columns else 0
    columns = tuple(_summary(found, column, column is time) for column in found.columns)
    named = time.header if time else None
    return Description(found.source, rows, columns, named, period, jitter, problem, found.log, dates)


def _summary(found: Table, column: Column, is_time: bool) -> ColumnSummary:
    values, text, *_ = casted(found, column.cells)
    cells = clean_text(column.cells) if column.cells.dtype == pl.String else column.cells
    numeric = mostly_numbers(found, column)
    finite = values[np.isfinite(values)] if numeric else np.zeros(0)
    first = tuple("" if cell is None else str(cell) for cell in _plain(column.cells.head(3)))
    missing = cells.null_count() + (int(cells.is_nan().sum()) if cells.dtype.is_float() else 0)
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    kind = "time" if is_time else "number" if numeric else "text"
    start = float(finite[0]) if len(finite) else None
    return ColumnSummary(
        column.header, identifier(column.name), column.unit, kind, missing, len(text), low, high, first, start
    )


def _plain(cells: pl.Series) -> list[Any]:
    """Cells as Python's; the numbers behind dates that are outside of its calendar, at which some polars panic."""
    if cells.dtype in (pl.Date, pl.Datetime):
        years = cells.dt.year()
        if not years.is_between(2, 9998).all():
            return cells.to_physical().to_list()
    return cells.to_list()
