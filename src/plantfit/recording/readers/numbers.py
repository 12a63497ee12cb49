"""Cells to float64 with NaN for what is missing."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl

from plantfit.errors import RecordingError
from plantfit.recording.readers.columns import Column, Table

MISSING = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?")
_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
# between thousands, with the decimal marks that may follow
_GROUPS = {",": ".", ".": ",", " ": ".,", "\u00a0": ".,", "\u202f": ".,", "'": ".,", "\u2019": ".,"}


def is_missing(cell: str | None) -> bool:
    """Whether a cell stands for no value."""
    return cell is None or cell.strip().lower() in MISSING


def is_number(cell: str) -> bool:
    """Whether a cell is a number with a decimal point or a decimal comma."""
    cell = cell.strip()
    return bool(
        _COMMA.fullmatch(cell) or re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf", cell, re.IGNORECASE)
    )


def clean_text(cells: pl.Series, also: Sequence[str] = ()) -> pl.Series:
    """Trimmed text, null where missing; `also` are other words for that."""
    text = cells.str.strip_chars(' \t"')
    words = [*MISSING, *(word.strip().lower() for word in also)]
    return pl.select(
        pl.when(text.str.to_lowercase().is_in(words)).then(None).otherwise(text).alias(cells.name)
    ).to_series()


def words_in(table: Table, column: Column) -> dict[str, int]:
    """Texts of a column of numbers that are none, and how often each stands there."""
    found: dict[str, int] = {}
    for row in casted(table, column.cells).text.tolist():
        word = str(column.cells[row]).strip()
        found[word] = found.get(word, 0) + 1
    return found


def thousands(text: pl.Series, decimal: str = "auto") -> tuple[str, str] | None:
    """What stands between thousands in the numbers of a column of trimmed text, and the decimal mark; None where no
    number has such a mark, or where it may be the decimal mark itself. Words without a digit are passed over.

    A comma or a point parts thousands for sure where the other mark follows it, or where it comes twice in a number.
    """
    text = text.filter(text.str.contains(r"\d").fill_null(False))
    for mark, ends in _GROUPS.items():
        if not text.str.contains(mark, literal=True).any():
            continue
        for end in ends if decimal == "auto" else (decimal if decimal in ends else ""):
            m, e = re.escape(mark), re.escape(end)
            group, rest = rf"{m}\d{{3}}", rf"({e}\d*)?"
            whole = rf"^[+-]?(\d{{1,3}}({group})+|\d+){rest}([eE][+-]?\d+)?$"
            sure = rf"^[+-]?\d{{1,3}}({group}){{2,}}|{group}{e}\d" if mark in ",." else group
            if text.str.contains(whole).all() and text.str.contains(sure).any():
                return mark, end
    return None


class Cast(NamedTuple):
    """Cells as numbers: `values` (n,), which may be those of the cells, the rows that hold text, whether a decimal
    `comma` was read, and the mark that was read between `thousands`, "" for none."""

    values: np.ndarray
    text: np.ndarray
    comma: bool = False
    thousands: str = ""


def casted(table: Table, cells: pl.Series) -> Cast:
    """Text or number cells as numbers, NaN for what is missing."""
    found = _casted(table, cells)
    codes = [float(word) for word in table.missing if is_number(word)]
    return found._replace(values=np.where(np.isin(found.values, codes), np.nan, found.values)) if codes else found


def _casted(table: Table, cells: pl.Series) -> Cast:
    if cells.dtype != pl.String:
        if not (cells.dtype.is_numeric() or cells.dtype == pl.Boolean or cells.dtype == pl.Null):
            return Cast(np.full(len(cells), np.nan), np.flatnonzero(cells.is_not_null().to_numpy()))
        values = cells.cast(pl.Float64)
        return Cast((values.fill_null(np.nan) if values.null_count() else values).to_numpy(), np.zeros(0, dtype=int))
    text = clean_text(cells, table.missing)
    point = (
        text.cast(pl.Float64, strict=False) if table.decimal != "," else pl.Series([None] * len(text), dtype=pl.Float64)
    )
    bad = (point.is_null() & text.is_not_null()).to_numpy()
    pointed = text.str.contains(".", literal=True).fill_null(False)
    comma_read, between = False, ""
    # one column must not mix the two marks: 1.5 and 1,5 could differ by a thousand
    if table.decimal == "," or (table.decimal == "auto" and bad.any() and not pointed.any()):
        comma = text.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)
        point = pl.select(pl.when(pointed).then(None).otherwise(comma)).to_series()
        bad = (point.is_null() & text.is_not_null()).to_numpy()
        comma_read = bool(text.str.contains(",", literal=True).any())
    if bad.any() and (marks := thousands(text, table.decimal)) is not None:
        between, end = marks
        plain = text.str.replace_all(between, "", literal=True).str.replace(end, ".", literal=True)
        point, comma_read = plain.cast(pl.Float64, strict=False), False
        bad = (point.is_null() & text.is_not_null()).to_numpy()
    return Cast(point.fill_null(np.nan).to_numpy(), np.flatnonzero(bad), comma_read, between)


def mostly_numbers(table: Table, column: Column) -> bool:
    """Whether at least half of the cells that are there, and at least one, are numbers."""
    if column.cells.dtype.is_numeric():
        return bool(column.cells.cast(pl.Float64).is_finite().any())
    found = casted(table, column.cells)
    count = int(np.isfinite(found.values).sum())
    return count > 0 and count >= len(found.text)


def numbers(table: Table, column: Column, purpose: str) -> tuple[np.ndarray, list[str]]:
    """Values (n,) and log sentences; raises RecordingError at the first text, with its place."""
    values, text, comma, between = casted(table, column.cells)
    if len(text):
        row = int(text[0])
        raise RecordingError(
            f"{table.where(row)}, column {column.header!r}: {str(column.cells[row])!r} is not a number; "
            f"correct that cell, empty it, choose another column for {purpose}, or say that it means a missing "
            f"value: missing = [{str(column.cells[row]).strip()!r}]."
        )
    if comma and table.decimal == "auto":
        refuse_both_marks(table, column)
        _refuse_thousands(table, column, values)
    log = [f"Column {column.header!r} was read with a decimal comma."] if comma else []
    log += [f"Column {column.header!r} was read with {between!r} between thousands."] if between else []
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
