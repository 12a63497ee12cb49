"""Time columns to seconds: numbers with a unit, ISO timestamps, or clock readings."""

import re
from datetime import datetime
from typing import Any

import numpy as np
import polars as pl

from plantfit.errors import RecordingError, UnitError
from plantfit.recording.readers.columns import Column, Table
from plantfit.recording.readers.numbers import casted, clean_text, is_missing, is_number, numbers
from plantfit.recording.readers.running_on import without_daylight_saving, without_overruns
from plantfit.recording.readers.timestamps import UNCLEAR, Dates, is_date, is_timestamp, readings, told_apart
from plantfit.units import compatible, factor_offset, known

_CLOCK = re.compile(r"(\d+):([0-5]?\d):([0-5]?\d(?:[.,]\d+)?)")
_WORDS = "t|time|zeit|elapsed|timestamp|temps|tiempo|tempo"
_UNITS = "ns|us|µs|ms|s|sec|min|h"
_SUFFIX = re.compile(rf"^(?:{_WORDS})[_ ]({_UNITS})$", re.IGNORECASE)
_NAMES = re.compile(
    rf"^({_WORDS}|date|datetime|sec|secs|second|seconds|sekunden|millis|micros|msec|usec|milliseconds|microseconds"
    rf"|millisekunden|mikrosekunden|time ?stamp|date ?time|elapsed "
    rf"time|zeitstempel|uhrzeit"
    rf"|datum|datum[ /]+uhrzeit|heure|horodatage|date et heure|hora|utc|x[-_ ]?axis|x[-_ ]?value|({_WORDS})[_ "
    rf"]({_UNITS}))$",
    re.IGNORECASE,
)
DISTINCT = 0.95  # of the rows, which have a time of their own
ORDER_WANTED = 'write dates = "day first" or dates = "month first" under [recording.NAME] (in Python dates="day first")'
FAR = 1e11  # s since 1970, in the year 5138
_DAYS = (20_000.0, 80_000.0)  # as spreadsheets count them since 1900: 1954 to 2119
_DATED = re.compile(r"^(date|datum)|date$|stamp|stempel|horodatage", re.IGNORECASE)
_AS_TIME = re.compile(r"\d{1,4}[:./-]\d{1,2}.*")
_BARE_UNITS = {"sec": "s", "secs": "s", "second": "s", "seconds": "s", "sekunden": "s", "millis": "ms", "micros": "us",
               "msec": "ms", "usec": "us", "milliseconds": "ms", "microseconds": "us", "millisekunden": "ms",
               "mikrosekunden": "us", "ms": "ms", "us": "us", "µs": "us"}  # fmt: skip
# words that may also count something, so that the unit has to say it
_TIMES = re.compile(r"(hours?|hrs?|days?|weeks?|min(ute)?s?|h|stunden?|tage?|jours?|heures?|d[ií]as?)", re.IGNORECASE)
_SOME_TIME = re.compile(r"(?<![a-z])(time|zeit|temps|tiempo)$", re.IGNORECASE)  # its unit and its values have to say it
RISING = 0.999  # of the rows of a column that only its unit calls a time
_UNITS_ALONE = {"ms", "us", "µs"}  # a header of only a unit; Us may be a voltage, too


def looks_like_time(cell: str) -> bool:
    """Whether a text is an ISO timestamp or a clock reading (not a plain number)."""
    if cell[:1].isalpha():
        return False
    cell = cell.strip()
    if _CLOCK.fullmatch(cell):
        return True
    return is_timestamp(cell)


def is_time_name(name: str) -> bool:
    """Whether a column of this name is taken as time."""
    return _NAMES.match(name) is not None


def guess_time(table: Table) -> Column | None:
    """The column that a reader would take as time: by its name, by its cells, by its unit where it is called so, or the
    first of a file without header.

    Of several names the first counts whose values are not the same in many rows, as those of a clock of whole seconds
    beside millis(). Dates alone come after clock readings, whose midnights are seen, and a field of a structure
    (data.t) counts by the name of the field.
    """
    named = [c for c in table.columns if is_time_name(c.name) or is_time_name(c.name.rpartition(".")[2])]
    whole = [c for c in named if not _dates_alone(c)]
    if whole or named:
        fine = [c for c in whole or named if c.cells.n_unique() > DISTINCT * len(c.cells)]
        return (fine or whole or named)[0]
    for column in table.columns:
        if column.cells.dtype.is_temporal():
            return column
        if column.cells.dtype == pl.String:
            filled = _first_cells(column)
            if filled and all(looks_like_time(cell) for cell in filled):
                return column
    for column in table.columns:
        alone = column.name.lower() in _UNITS_ALONE and column.unit is None
        if alone or _named_by_unit(column):
            values, text, *_ = casted(table, column.cells)
            if not len(text) and len(values) > 2 and np.mean(np.diff(values) > 0) > (0.9 if alone else RISING):
                return column
    if not table.header and table.columns:
        values, text, *_ = casted(table, table.columns[0].cells)
        if not len(text) and len(values) > 2 and np.all(np.diff(values) > 0):
            return table.columns[0]
    return None


def _named_by_unit(column: Column) -> bool:
    """Whether a column is called by its unit of time, as day [day] and Hours (h) are, or a time of something in one, as
    Test_Time(s) of a cycler."""
    if column.unit is None or (_TIMES.fullmatch(column.name) is None and _SOME_TIME.search(column.name) is None):
        return False
    return known(column.unit) and compatible(column.unit, "s")


def _first_cells(column: Column) -> list[str]:
    return [cell for cell in column.cells.head(20).to_list() if not is_missing(cell)]


def _dates_alone(column: Column) -> bool:
    if column.cells.dtype == pl.Date:
        return True
    return column.cells.dtype == pl.String and all(is_date(cell) for cell in _first_cells(column))


def time_unit_of(column: Column, given: str | None) -> tuple[str, str]:
    """(unit, how it is known) for a time column of numbers; raises UnitError for a contradiction or a unit that is
    no time."""
    suffix = _SUFFIX.match(column.name)
    stated = column.unit or (suffix[1] if suffix else _BARE_UNITS.get(column.name.lower()))
    if stated is not None and not compatible(stated, "s"):
        if given is None:
            raise UnitError(
                f"Time column {column.header!r} has the unit {stated!r}, "
                "which is not a unit of time; choose another column."
            )
        stated = None
    if given is not None:
        if not compatible(given, "s"):
            raise UnitError(f"time_unit {given!r} is not a unit of time; use 's', 'ms', 'us', 'min', 'h' or 'day'.")
        if stated is not None and factor_offset(given, stated) != (1.0, 0.0):
            raise UnitError(
                f"Time column {column.header!r} says {stated!r} but time_unit "
                f"is {given!r}; leave time_unit out or correct the header."
            )
        return given, "given"
    return (stated, "stated by the file") if stated is not None else ("s", "assumed, the file names no unit")


def may_be_milliseconds(table: Table) -> bool:
    """Whether times without a unit, which are taken as seconds, are whole numbers several apart, as of millis()."""
    column = guess_time(table)
    if column is None or column.cells.dtype.is_temporal():
        return False
    values, text, *_ = casted(table, column.cells)
    try:
        known_by = time_unit_of(column, None)[1]
    except UnitError:
        return False
    steps = np.abs(np.diff(values))
    whole = len(steps) > 2 and np.isfinite(values).all() and bool(np.all(values == np.round(values)))
    return not len(text) and known_by.startswith("assumed") and bool(whole) and float(np.median(steps)) > 1


def seconds(table: Table, column: Column, time_unit: str | None, dates: Dates | None = None) -> tuple[np.ndarray, str]:
    """Times (n,) in seconds and a log sentence; timestamps and clock readings count from the first row."""
    cells = column.cells
    if cells.dtype.is_temporal():
        _refuse_unit(column, time_unit, "dates or clock readings")
        values = _from_temporal(table, column)
        told = f"Time from {column.header!r}, in seconds from the first row."
        if cells.dtype == pl.Datetime and cells.dtype.time_zone is None:  # pyrefly: ignore[missing-attribute]
            values, said = without_daylight_saving(values, cells[0], table)
            told += said
        return values, told
    if cells.dtype == pl.String:
        text = clean_text(cells).to_list()
        first = next((cell for cell in text if cell is not None), "")
        if looks_like_time(first):
            _refuse_unit(column, time_unit, "timestamps or clock readings")
            return _from_text(table, column, text, first, dates)
        if _AS_TIME.fullmatch(first) and not is_number(first):
            _refuse_unread(table, column, text.index(first), first)
    values, _ = numbers(table, column, "time")
    _no_gaps(table, column, np.isfinite(values))
    try:
        unit, known_by = time_unit_of(column, time_unit)
    except UnitError as error:
        raise UnitError(f"{table.source}: {error}") from None
    if known_by.startswith("assumed") and np.min(np.abs(values)) >= FAR:
        _refuse_far(table, column, float(values[0]))
    if known_by.startswith("assumed") and _DATED.search(column.name) and _in_days(values):
        raise UnitError(
            f"{table.source}: time column {column.header!r} has no unit and begins at {values[0]:.9g}, as days do "
            "that a spreadsheet counts since 1900; say time_unit = 'day' in the study file (or 's' if these are "
            f"seconds), or write the unit into the header, as in '{column.header} [day]'."
        )
    factor, _ = factor_offset(unit, "s")
    # a division keeps 7 ms at 0.007 s to the last bit, a product does not
    values = values / round(1 / factor) if factor < 1 else values * factor
    values, said = without_overruns(values, table)
    return values, f"Time from {column.header!r} in {unit} ({known_by}).{said}"


def _refuse_far(table: Table, column: Column, first: float) -> None:
    """Numbers since 1970 of loggers are in ms, us or ns where they would be in the year 5000 in s."""
    unit = "ms" if abs(first) < 1e14 else "us" if abs(first) < 1e17 else "ns"
    raise UnitError(
        f"{table.source}: time column {column.header!r} has no unit and begins at {first:.6g}, "
        f"thousands of years in s; say its unit in the study file, as in time_unit = {unit!r} for {unit} "
        f"since 1970, or in the header, as in '{column.header} [{unit}]'."
    )


def _in_days(values: np.ndarray) -> bool:
    """Whether numbers (n,) may be days of our time, counted since 1900."""
    return bool(_DAYS[0] <= values.min() and values.max() <= _DAYS[1])


def _refuse_unread(table: Table, column: Column, row: int, cell: str) -> None:
    """What looks like a time and is none that is read."""
    if re.fullmatch(r"\d+:\d\d(?:[.,]\d+)?", cell):
        hours, rest = cell.split(":")
        seen = f"may be minutes and seconds, or hours and minutes; write 00:{cell}, or {hours}:{rest}:00"
    elif re.search(r":\d\d(?:[.,]\d+)?\s*[A-Za-z]", cell):
        seen = "ends in a word; write the zone as an offset (2024-05-31 13:05:59+02:00), or leave it out"
    else:
        seen = "is no time that can be read; write 2024-05-31 13:05:59, 13:05:59 or a number"
    raise RecordingError(f"{table.where(row)}, time column {column.header!r}: {cell!r} {seen}.")


def _refuse_unit(column: Column, time_unit: str | None, kind: str) -> None:
    if time_unit is not None:
        raise UnitError(
            f"Time column {column.header!r} holds {kind}, which have no unit {time_unit!r}; leave time_unit out."
        )


def _no_gaps(table: Table, column: Column, there: np.ndarray) -> None:
    if not there.all():
        raise RecordingError(
            f"{table.where(int(np.argmin(there)))}: time column "
            f"{column.header!r} is empty; fill in the time or delete that row."
        )


def _from_temporal(table: Table, column: Column) -> np.ndarray:
    cells = column.cells
    _no_gaps(table, column, cells.is_not_null().to_numpy())
    # 64 bits of nanoseconds reach no farther, and older polars do not say so
    if cells.dtype in (pl.Date, pl.Datetime) and not cells.dt.year().is_between(1678, 2261).all():
        raise RecordingError(
            f"{table.source}: time column {column.header!r} holds dates "
            "before 1678 or after 2261; correct them, or give seconds."
        )
    nanoseconds = (
        cells.cast(pl.Datetime("ns") if cells.dtype in (pl.Date, pl.Datetime) else cells.dtype)
        .to_physical()
        .cast(pl.Int64)
    )
    if cells.dtype == pl.Time:  # of a day, which may end
        days = np.concatenate([[0], np.cumsum(np.diff(nanoseconds.to_numpy()) < -43_200_000_000_000)])
        nanoseconds = nanoseconds + pl.Series(days * 86_400_000_000_000)
    ticks = (
        {"ms": 1e3, "us": 1e6, "ns": 1e9}[getattr(cells.dtype, "time_unit", None) or "ns"]
        if cells.dtype == pl.Duration
        else 1e9
    )
    return (nanoseconds - nanoseconds[0]).to_numpy() / ticks


def _from_text(
    table: Table, column: Column, text: list[str | None], first: str, dates: Dates | None
) -> tuple[np.ndarray, str]:
    _no_gaps(table, column, np.array([cell is not None for cell in text]))
    clock = _CLOCK.fullmatch(first) is not None
    alike: list[Any] = [[_clock_seconds(cell or "") for cell in text]] if clock else readings(text, dates)
    if None in alike[0]:
        row = alike[0].index(None)
        kind = "a clock reading like 13:05:59.2" if clock else "a timestamp like 2024-05-31T13:05:59.2"
        said = f" with the {dates}, as dates says" if dates and not clock else ""
        raise RecordingError(
            f"{table.where(row)}, time column {column.header!r}: {text[row]!r} is not {kind}{said}; correct that cell."
        )
    if clock:
        return _past_midnight(np.array(alike[0], dtype=float), column)
    if told_apart(alike):
        _refuse_dates(table, column, UNCLEAR)
    found = [_from_stamps(table, column, stamps) for stamps in alike]
    starts = [stamps[0] for stamps in alike]
    values, told = found[0]
    if any(not np.array_equal(values, other) for other, _ in found):
        _refuse_dates(table, column, f"{UNCLEAR}, and only some of them are a night in which clocks are put")
    if len({*starts}) > 1:
        days = " or ".join(f"{start:%Y-%m-%d}" for start in starts)
        when = f"{starts[0]:%H:%M:%S} on {days}: day and month can be exchanged, and the times are the same"
    else:
        when = f"{starts[0]}"
    return values, f"Time from the timestamps {column.header!r}, in seconds from {when}.{told}"


def _refuse_dates(table: Table, column: Column, why: str) -> None:
    raise RecordingError(
        f"{table.source}: time column {column.header!r}: {why}; {ORDER_WANTED}, or the dates as 2024-05-31 13:05:59."
    )


def _from_stamps(table: Table, column: Column, stamps: list) -> tuple[np.ndarray, str]:
    """Times (n,) in s from the first of the stamps, without changes of the clock, and what is told of these."""
    start = stamps[0]
    try:
        values = np.array([(stamp - start).total_seconds() for stamp in stamps])
    except TypeError:
        raise RecordingError(
            f"{table.source}: time column {column.header!r} mixes "
            "timestamps with and without a time zone; write all alike."
        ) from None
    if isinstance(start, datetime) and start.tzinfo is None:
        return without_daylight_saving(values, start, table)
    return values, ""


def _clock_seconds(cell: str) -> float | None:
    found = _CLOCK.fullmatch(cell)
    return None if found is None else 3600.0 * int(found[1]) + 60.0 * int(found[2]) + float(found[3].replace(",", "."))


def _past_midnight(values: np.ndarray, column: Column) -> tuple[np.ndarray, str]:
    days = np.concatenate([[0], np.cumsum(np.diff(values) < -43200)])
    tail = f", past midnight {int(days[-1])} times" if days[-1] else ""
    # rounding to the nanosecond takes back what the subtraction of a large clock reading left behind
    return np.round(
        values - values[0] + 86400.0 * days, 9
    ), f"Time from the clock readings {column.header!r}, in seconds from the first{tail}."
