"""Cells to float64 with NaN for what is missing."""

import re

import numpy as np
import polars as pl

from plantfit.errors import RecordingError
from plantfit.recording.readers.columns import Column, Table

MISSING = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?")
_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")


def is_missing(cell: str | None) -> bool:
    """Whether a cell stands for no value."""
    return cell is None or cell.strip().lower() in MISSING


def is_number(cell: str) -> bool:
    """Whether a cell is a number with a decimal point or a decimal comma."""
    cell = cell.strip()
    return bool(
        _COMMA.fullmatch(cell) or re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf", cell, re.IGNORECASE)
    )


def clean_text(cells: pl.Series) -> pl.Series:
    """Trimmed text, null where missing."""
    text = cells.str.strip_chars(' \t"')
    return pl.select(
        pl.when(text.str.to_lowercase().is_in(list(MISSING))).then(None).otherwise(text).alias(cells.name)
    ).to_series()


def casted(table: Table, cells: pl.Series) -> tuple[np.ndarray, np.ndarray, bool]:
    """(values (n,), which may be those of the cells, rows that hold text, whether a decimal comma was read) for text
    or number cells."""
    if cells.dtype != pl.String:
        if not (cells.dtype.is_numeric() or cells.dtype == pl.Boolean or cells.dtype == pl.Null):
            return np.full(len(cells), np.nan), np.flatnonzero(cells.is_not_null().to_numpy()), False
        values = cells.cast(pl.Float64)
        return (values.fill_null(np.nan) if values.null_count() else values).to_numpy(), np.zeros(0, dtype=int), False
    text = clean_text(cells)
    point = (
        text.cast(pl.Float64, strict=False) if table.decimal != "," else pl.Series([None] * len(text), dtype=pl.Float64)
    )
    bad = (point.is_null() & text.is_not_null()).to_numpy()
    pointed = text.str.contains(".", literal=True).fill_null(False)
    comma_read = False
    # one column must not mix the two marks: 1.5 and 1,5 could differ by a thousand
    if table.decimal == "," or (table.decimal == "auto" and bad.any() and not pointed.any()):
        comma = text.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)
        point = pl.select(pl.when(pointed).then(None).otherwise(comma)).to_series()
        bad = (point.is_null() & text.is_not_null()).to_numpy()
        comma_read = bool(text.str.contains(",", literal=True).any())
    return point.fill_null(np.nan).to_numpy(), np.flatnonzero(bad), comma_read


def mostly_numbers(table: Table, column: Column) -> bool:
    """Whether at least half of the cells that are there, and at least one, are numbers."""
    if column.cells.dtype.is_numeric():
        return bool(column.cells.cast(pl.Float64).is_finite().any())
    values, text, _ = casted(table, column.cells)
    count = int(np.isfinite(values).sum())
    return count > 0 and count >= len(text)


def numbers(table: Table, column: Column, purpose: str) -> tuple[np.ndarray, list[str]]:
    """Values (n,) and log sentences; raises RecordingError at the first text, with its place."""
    values, text, comma = casted(table, column.cells)
    if len(text):
        row = int(text[0])
        raise RecordingError(
            f"{table.where(row)}, column {column.header!r}: {str(column.cells[row])!r} is not a number; "
            f"correct that cell, empty it, or choose another column for {purpose}."
        )
    if comma and table.decimal == "auto":
        refuse_both_marks(table, column)
        _refuse_thousands(table, column, values)
    log = [f"Column {column.header!r} was read with a decimal comma."] if comma else []
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(values.sum()):  # nothing is missing
            return values, log
    infinite = int(np.isinf(values).sum())
    if infinite:
        values = np.where(np.isinf(values), np.nan, values)
        log.append(f"{infinite} infinite values of {column.header!r} count as missing.")
    if not np.isfinite(values).any():
        raise RecordingError(
            f"{table.source}: column {column.header!r} for {purpose} holds no numbers; choose another column."
        )
    missing = int(np.isnan(values).sum())
    if missing:
        log.append(f"{missing} of {len(values)} values of {column.header!r} are missing.")
    return values, log


def _refuse_thousands(table: Table, column: Column, values: np.ndarray) -> None:
    """Where 1,000 follows 999, the comma parts thousands: then nothing is guessed either."""
    text = clean_text(column.cells).drop_nulls()
    with_comma = text.str.contains(",", literal=True)
    grouped, plain = text.filter(with_comma), text.filter(~with_comma)
    if (
        not plain.str.contains(r"^[+-]?[1-9]\d\d$").any()
        or not grouped.str.contains(r"^[+-]?[1-9]\d{0,2},\d{3}$").all()
    ):
        return
    thousands = text.str.replace(",", "", literal=True).cast(pl.Float64, strict=False).drop_nulls().to_numpy()
    if _sweeps(thousands) < _sweeps(values[np.isfinite(values)]):
        raise RecordingError(
            f"{table.source}: column {column.header!r} has {grouped[0]!r} beside whole "
            f"numbers such as {plain[0]!r}, so that the comma may part thousands; write "
            "its numbers without them, or give decimal=',' if it is a decimal comma."
        )


def _sweeps(values: np.ndarray) -> float:
    """How often values (n,) run through their range."""
    return float(np.sum(np.abs(np.diff(values))) / max(float(np.ptp(values)), 1e-300)) if len(values) else 0.0


def refuse_both_marks(table: Table, comma: Column) -> None:
    """Where other columns have decimal points, a comma may part thousands: then nothing is guessed."""
    for other in table.columns:
        if other.cells.dtype == pl.String and other.cells.str.contains(r"^\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*$").any():
            raise RecordingError(
                f"{table.source}: column {comma.header!r} has commas in its numbers but {other.header!r} has points; "
                "write both alike, or give decimal=',' or decimal='.'."
            )
