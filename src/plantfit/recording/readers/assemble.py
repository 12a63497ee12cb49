"""The one way from columns to a recording, shared by all readers."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypedDict, Unpack

import numpy as np

from plantfit.errors import ClockError, NoTimeError, RecordingError, UnitError
from plantfit.recording.readers.clock import guess_time, seconds
from plantfit.recording.readers.columns import Column, Table, close_match, identifier, unknown_unit
from plantfit.recording.readers.long_tables import widened
from plantfit.recording.readers.numbers import mostly_numbers, numbers
from plantfit.recording.readers.timestamps import ORDERS, Dates
from plantfit.recording.record import Recording, Signal
from plantfit.units import gauge, logarithmic, parse

RUN = 10  # rows, of which a part of a file may be a run of its own
YEARS = 1e8  # s, three years: no board counts so far from its start


class Options(TypedDict, total=False):
    """What every reader takes.

    `time`: column of time (header or number); left out, it is recognised by its name or cells.
    `period`: seconds between rows, instead of a time column.
    `time_unit`: unit of a time column of numbers whose header has none.
    `dates`: "day first", "month first" or "year first", where the dates of time stamps do not tell it.
    `signals`: own names to columns, or a list of columns; left out, every column of numbers.
    `units`: units by own name, for columns whose header has none.
    `missing`: words and numbers in cells that stand for no value, such as "Bad" and -999.
    `sort`: allow rows out of order. `duplicates`: what to do with rows of equal time.
    `name`: of the recording.
    """

    time: str | int | None
    period: float | None
    time_unit: str | None
    dates: Dates | None
    signals: Mapping[str, str | int] | Sequence[str | int] | None
    units: Mapping[str, str] | None
    missing: Sequence[str | float] | None
    sort: bool
    duplicates: Literal["mean", "first"] | None
    name: str | None


def assemble(table: Table, **options: Unpack[Options]) -> Recording:
    """A recording from the columns of a table; raises RecordingError or UnitError with file and line."""
    _check_options(table, options)
    if words := options.get("missing"):
        table = replace(table, missing=_words(table, words))
    table = widened(table)
    t, time_column, log = _time(table, options)
    chosen, chosen_log = _chosen(table, options.get("signals"), time_column)
    log = [*table.log, *log, *chosen_log]
    values, units = {}, {}
    for name, column in chosen.items():
        values[name], said = numbers(table, column, f"signal {name!r}")
        log += said
        units[name] = column.unit
    units = _with_given_units(table, units, options.get("units") or {}, chosen)
    log += [
        f"{brackets_told(c.header, unknown)}."
        for n, c in chosen.items()
        if units[n] is None and (unknown := unknown_unit(c.header))
    ]
    count, values, t, said = _in_order(table, t, values, options.get("sort", False), options.get("duplicates"))
    signals = {name: Signal(array, units[name]) for name, array in values.items()}
    name = options.get("name") or table.source
    told = (*log, *said, f"{count} samples of {list(signals)} from {t[0]:g} s to {t[-1]:g} s.")
    return Recording(t, signals, name, told, time_column is not None)


def _words(table: Table, given: Sequence[str | float]) -> tuple[str, ...]:
    words = [given] if isinstance(given, str | int | float) else list(given)
    if wrong := [w for w in words if isinstance(w, bool) or not isinstance(w, str | int | float)]:
        raise RecordingError(
            f"{table.source}: missing holds {wrong[0]!r}; give words and numbers, as in missing=['Bad', -999]."
        )
    return tuple(str(word) for word in words)


def brackets_told(header: str, unknown: str) -> str:
    """What became of a header whose brackets hold no known unit."""
    return (
        f"{unknown!r} in the header {header!r} is not a known unit and "
        "counts as part of the name; correct it, or state the unit in units"
    )


def _check_options(table: Table, options: Options) -> None:
    unknown = [key for key in options if key not in Options.__annotations__]
    if unknown:
        hint = close_match(unknown[0], Options.__annotations__)
        raise RecordingError(
            f"{table.source}: unknown reading option {unknown[0]!r}{hint}; known are {list(Options.__annotations__)}."
        )
    if options.get("duplicates") not in (None, "mean", "first"):
        raise RecordingError(f"{table.source}: duplicates is {options.get('duplicates')!r}; use 'mean' or 'first'.")
    if options.get("dates") not in (None, *ORDERS):
        raise RecordingError(
            f"{table.source}: dates is {options.get('dates')!r}; use one of {', '.join(map(repr, ORDERS))}."
        )
    if options.get("time") is not None and options.get("period") is not None:
        raise RecordingError(f"{table.source}: both time and period are given; leave one of them out.")
    if not table.columns or not len(table.columns[0].cells):
        raise RecordingError(f"{table.source} holds no rows of data; check that the file is complete.")


def _time(table: Table, options: Options) -> tuple[np.ndarray, Column | None, list[str]]:
    period, wanted = options.get("period"), options.get("time")
    if period is not None:
        if not (np.isfinite(period) and period > 0):
            raise RecordingError(f"{table.source}: period is {period!r}; give the seconds between two rows, above 0.")
        return (
            np.arange(len(table.columns[0].cells)) * float(period),
            None,
            [f"Time counted from 0 in steps of {period:g} s."],
        )
    column = table.column(wanted, "time") if wanted is not None else guess_time(table)
    if column is None and table.period is not None:
        name, step = table.period
        return (
            step * np.arange(len(table.columns[0].cells)),
            None,
            [f"Time counted from 0 in steps of {step:g} s, by {name!r}."],
        )
    if column is None:
        raise NoTimeError(
            f"{table.source}: no column looks like time; give time= one of "
            f"{[c.header for c in table.columns]} or period= in seconds; rows that have no times, as those of a static "
            "curve, take period = 1."
        )
    t, sentence = seconds(table, column, options.get("time_unit"), options.get("dates"))
    return t, column, [sentence]


def _chosen(
    table: Table, wanted: Mapping[str, str | int] | Sequence[str | int] | None, time: Column | None
) -> tuple[dict[str, Column], list[str]]:
    if isinstance(wanted, Mapping):
        chosen = {str(name): table.column(column, f"signal {name!r}") for name, column in wanted.items()}
        log = []
    elif wanted is not None:
        columns = [wanted] if isinstance(wanted, (str, int)) else list(wanted)
        chosen, log = _own_names([table.column(column, "a signal") for column in columns], table)
    else:
        others = [column for column in table.columns if column is not time]
        numeric = [column for column in others if mostly_numbers(table, column)]
        chosen, log = _own_names(numeric, table)
        log += [
            f"Column {column.header!r} holds no numbers and was left out." for column in others if column not in numeric
        ]
        log += [f"{name!r} was left out because {why}." for name, why in table.left_out.items()]
    if not chosen:
        raise RecordingError(
            f"{table.source}: there is no column of numbers besides the time; the file has "
            f"{[c.header for c in table.columns]}."
        )
    return chosen, log


def _own_names(columns: Sequence[Column], table: Table) -> tuple[dict[str, Column], list[str]]:
    chosen: dict[str, Column] = {}
    log = []
    for column in columns:
        clean = name = identifier(column.name)
        count = 1
        while name in chosen:
            count += 1
            name = f"{clean}_{count}"
        if name != clean:
            log.append(
                f"Column {[*table.columns].index(column)} ({column.header!r}) "
                f"is called {name!r}, because {clean!r} was taken."
            )
        chosen[name] = column
    return chosen, log


def _with_given_units(
    table: Table, units: Mapping[str, str | None], given: Mapping[str, str], chosen: Mapping[str, Column]
) -> dict[str, str | None]:
    result = dict(units)
    for name, unit in given.items():
        if name not in units:
            raise RecordingError(
                f"{table.source}: units names {name!r}{close_match(name, units)}, which is not a signal; the signals "
                f"are {list(units)}."
            )
        try:
            parse(unit)
        except UnitError as error:
            raise UnitError(f"{table.source}: units gives {name!r} a unit that cannot be used: {error}") from None
        stated = units[name]
        if stated is not None and logarithmic(stated):
            raise UnitError(
                f"{table.source}: column {chosen[name].header!r} is in {stated!r}, which is "
                f"logarithmic, but units says {unit!r} for {name!r}; convert the values of the column, "
                f"or leave {name!r} out of units and declare it without a unit to compute with levels."
            )
        if stated is not None and not _may_mean(stated, unit) and parse(stated) != parse(unit):
            raise UnitError(
                f"{table.source}: column {chosen[name].header!r} says {stated!r}, but units "
                f"says {unit!r} for {name!r}; leave {name!r} out of units, or correct the "
                f"header. A value in {stated!r} is converted to the unit of the model."
            )
        result[name] = unit
    return result


def _may_mean(stated: str, unit: str) -> bool:
    """Whether a unit in a header may be written for another one: bar of bar(g), and temperatures in "C" or "F"."""
    plain = gauge(stated) or {"C": "degC", "F": "degF"}.get(stated)
    return plain is not None and parse(plain) == parse(unit)


def _in_order(
    table: Table, t: np.ndarray, values: dict[str, np.ndarray], sort: bool, duplicates: str | None
) -> tuple[int, dict[str, np.ndarray], np.ndarray, list[str]]:
    """How many samples are left, their values and times, in the order of time, and log sentences."""
    steps = np.diff(t)
    if np.all(steps > 0):
        return len(t), values, t, []
    order, log = np.arange(len(t)), []
    back = np.flatnonzero(steps < 0)
    if len(back) and not sort:
        row = int(back[0]) + 1
        if _begins_anew(t, back, values):
            raise ClockError(
                f"{table.where(row)}: time goes back from {t[row - 1]:.9g} s to {t[row]:.9g} s and begins anew there, "
                "as where a board was started again or a file holds several runs, which sorting would mix. Cut the "
                f"file there{_more(table, back)}, the header above every part, and give each a [recording.NAME] of "
                "its own."
            )
        raise ClockError(
            f"{table.where(row)}: time goes back from {t[row - 1]:.9g} s to {t[row]:.9g} s; sort the rows "
            "(sort = true in the study file, sort=True in Python), or cut the file there if it holds two runs.",
            "sort = true",
        )
    if len(back):
        order = np.argsort(t, kind="stable")
        log.append(f"Rows were sorted by time; time went back {len(back)} times.")
    t = t[order]
    values = {name: array[order] for name, array in values.items()}
    same = np.flatnonzero(np.diff(t) == 0)
    if not len(same):
        return len(t), values, t, log
    if duplicates is None:
        row = int(order[same[0] + 1])
        raise ClockError(
            f"{table.where(row)}: time {t[same[0]]:.9g} s appears twice; "
            "give duplicates = 'mean', or 'first' to keep the first row; replicates count as samples of their own in "
            "recordings of their own.",
            'duplicates = "mean"',
        )
    starts = np.concatenate([[0], np.flatnonzero(np.diff(t) > 0) + 1])
    merge = _first if duplicates == "first" else _mean
    log.append(f"{len(same)} rows of repeated time were merged ({duplicates}).")
    return len(starts), {name: merge(array, starts) for name, array in values.items()}, t[starts], log


def _begins_anew(t: np.ndarray, back: np.ndarray, values: Mapping[str, np.ndarray]) -> bool:
    """Whether times (n,) that go back after the rows `back` are those of runs one after the other.

    Rows out of order come back to where they were, and the pieces of a record in the wrong order meet. Times of runs
    overlap, or are a gap apart that counts from the start of a board. Tables of several sensors, one below the other,
    overlap, too, but no signal has values in two of them.
    """
    edges = np.r_[0, back + 1, len(t)]
    parts = [slice(a, b) for a, b in itertools.pairwise(edges)]
    forward = np.diff(t)[np.diff(t) > 0]
    if not len(forward) or min(p.stop - p.start for p in parts) < RUN:
        return False
    there = np.array([[np.isfinite(v[p]).any() for p in parts] for v in values.values()])
    if not np.any(there.sum(axis=1) > 1):
        return False
    begins = np.array([t[p][0] for p in parts])
    order = np.argsort(begins)
    gaps = begins[order][1:] - np.array([t[p][-1] for p in parts])[order][:-1]
    far = RUN * np.median(forward)  # rows that came late overlap by less
    since_start = t.min() >= 0 and t.max() < YEARS
    return bool(np.any(gaps < -far) or (since_start and np.any(gaps > far)))


def _more(table: Table, back: np.ndarray) -> str:
    """Where else times go back."""
    if len(back) < 2:
        return ""
    lines = [table.where(int(row) + 1).rpartition(" ")[2] for row in back[1:6]]
    return f" and at {table.place} {', '.join(lines)}" + (" and further ones" if len(back) > 6 else "")


def _first(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    return values[starts]


def _mean(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    there = np.isfinite(values)
    total = np.add.reduceat(np.where(there, values, 0.0), starts)
    count = np.add.reduceat(there.astype(float), starts)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
