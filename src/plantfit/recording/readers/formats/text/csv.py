"""Text tables: the delimiter, the header, units and decimal commas are found, then polars reads."""

import csv as standard_csv
import io
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Unpack

import numpy as np
import polars as pl

from plantfit.errors import RecordingError
from plantfit.recording.readers.assemble import Options, assemble
from plantfit.recording.readers.clock import looks_like_time
from plantfit.recording.readers.columns import Table, named_columns
from plantfit.recording.readers.files import decoded, existing, read_bytes
from plantfit.recording.readers.formats.text.header import above_the_table, headings, is_header, unique, unit_row
from plantfit.recording.readers.formats.text.labelled import table_of_labels
from plantfit.recording.readers.formats.text.plain_text import ENOUGH, head_of, plain_frame
from plantfit.recording.readers.formats.text.received import is_received, name_of_stamps, stamped
from plantfit.recording.readers.numbers import is_missing, is_number
from plantfit.recording.record import Recording

COMMENTS = ("#", "%", "//")
LOG_MARK = "# plantfit log: "
FIRST_LINES = 200  # in which the table begins
_DELIMITERS = ("\t", ";", "|", ",", " ")
_NAMES = {"\t": "tab", " ": "white space"}


def read_csv(
    path: str | os.PathLike[str],
    *,
    delimiter: str | None = None,
    decimal: Literal["auto", ".", ","] = "auto",
    header: bool | None = None,
    skip: int = 0,
    **options: Unpack[Options],
) -> Recording:
    """A recording from a text table (.csv, .tsv, .txt, .dat, gzip or not).

    `delimiter`, `decimal` and `header` are found when left out; quoted numbers like "1,5" between
    commas need delimiter="," and decimal=",". `skip` lines at the top are not looked at. `options`
    are those of `assemble.Options`: time, period, time_unit, dates, signals, units, sort, duplicates, name.
    Units stand in the header as "u [V]" or "u (V)" or in a row below it; columns without header are
    named "0", "1", ... Raises RecordingError with file and line.
    """
    return assemble(csv_table(path, delimiter=delimiter, decimal=decimal, header=header, skip=skip), **options)


@dataclass(frozen=True)
class _Lines:
    """Lines with content, their numbers in the file from 1, and the comment lines before them; `labelled` where their
    header was made of the labels in them. `received`: by number, when a serial monitor says that a line came."""

    source: str
    lines: list[str]
    numbers: list[int]
    leading: list[str]
    comments: int
    labelled: bool = False
    received: dict[int, str] = field(default_factory=dict)


def csv_table(
    path: str | os.PathLike[str],
    *,
    delimiter: str | None = None,
    decimal: str = "auto",
    header: bool | None = None,
    skip: int = 0,
) -> Table:
    """The columns of a text table, not yet interpreted."""
    file = existing(path)
    if decimal not in ("auto", ".", ","):
        raise RecordingError(f"{file.name}: decimal is {decimal!r}; use '.', ',' or 'auto'.")
    if delimiter is not None and (len(delimiter.encode()) != 1 or delimiter in '"\n\r'):
        raise RecordingError(
            f"{file.name}: delimiter is {delimiter!r}; give one character, or ' ' for any white space."
        )
    data = read_bytes(file)
    quick = _quickly(file.name, data, delimiter, decimal, header, skip)
    if quick is not None:
        return quick
    text, encoding = decoded(data, file)
    del data
    found = _content(file.name, text, skip)
    del text
    top = _top(found, delimiter, decimal, header)
    frame, places = _parse(found, top.first, top.separator, len(top.rows[0]), top.log)
    times = [found.received.get(int(place)) for place in places] if found.received else None
    return _table(file.name, encoding, top, frame, places, decimal, times)


@dataclass(frozen=True)
class _Top:
    """What the first lines say: the delimiter, some rows, names and units where there are any, and the index of the
    first row of data."""

    separator: str
    rows: list[list[str]]
    names: list[str] | None
    units: list[str | None] | None
    first: int
    log: list[str]
    story: list[str]  # of the recording before it was written


def _top(found: _Lines, delimiter: str | None, decimal: str, header: bool | None) -> _Top:
    separator = delimiter or _sniff(found.lines, allow_comma=decimal != ",")
    rows = _fields_of(found.lines[:FIRST_LINES], separator)
    above = above_the_table(rows) if header is None else 0
    rows = rows[above : above + 3]
    story = [line[len(LOG_MARK) :] for line in found.leading if line.startswith(LOG_MARK)]
    log = [f"{found.comments} comment lines were skipped."] if found.comments else []
    if found.labelled:
        log.append("Names are the labels beside the numbers of each row.")
    if found.received:
        log.append("The serial monitor's times before -> are a column of their own.")
    if above:
        log.append(f"{above} lines above the table were skipped.")
    names, units, first = _header(rows, header, found, separator, log, above)
    return _Top(separator, rows, names, units, above + first, log, story)


def _quickly(
    source: str, data: bytes, delimiter: str | None, decimal: str, header: bool | None, skip: int
) -> Table | None:
    """The table of a long file of plain rows, or None where it has to be read line by line."""
    head = head_of(data)
    if head is None or decimal == "," or skip < 0:
        return None
    try:
        found = _content(source, head, skip)
        top = _top(found, delimiter, decimal, header)
    except RecordingError:  # a cell in quotation marks may go on behind the head
        return None
    if found.labelled or found.received:
        return None
    rows = _fields_of(found.lines[top.first : top.first + ENOUGH], top.separator)
    plain = plain_frame(data, rows, found.numbers[top.first], top.separator) if len(rows) == ENOUGH else None
    if plain is None:
        return None
    if plain.cut is not None:
        top.log.append(_cut(plain.cut))
    places = range(plain.first, plain.first + plain.frame.height)
    return _table(source, "UTF-8", top, plain.frame, places, decimal)


def _table(
    source: str,
    encoding: str,
    top: _Top,
    frame: pl.DataFrame,
    places: Sequence[int] | np.ndarray,
    decimal: str,
    times: list[str | None] | None = None,
) -> Table:
    log = [
        *top.story,
        f"Read from {source} ({encoding}, delimiter {_NAMES.get(top.separator, top.separator)}).",
        *top.log,
    ]
    named = top.names is not None
    columns = named_columns(unique(top.names or headings(frame.width)), frame.get_columns(), top.units)
    # a delimiter at the end of every line makes an empty column without name
    columns = tuple(
        c
        for i, c in enumerate(columns)
        if not (c.cells.null_count() == len(c.cells) and named and not (top.names or [])[i].strip())
    )
    if times is not None:
        columns = (*named_columns([name_of_stamps(top.names)], [pl.Series(times, dtype=pl.String)]), *columns)
    mark = "." if top.separator == "," and decimal == "auto" else decimal
    return Table(source, columns, places, "line", mark, named, tuple(log))


def _cut(line: int) -> str:
    return f"The last line ({line}) is incomplete and was left out."


def _content(source: str, text: str, skip: int) -> _Lines:
    if skip < 0:
        raise RecordingError(f"{source}: skip is {skip}; give the number of lines to pass over, 0 or more.")
    lines, numbers, leading, comments = [], [], [], 0
    raw = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    pending = ""
    monitor, received = is_received(raw[skip:]), {}
    for number, line in enumerate(raw[skip:], start=skip + 1):
        if monitor and (pair := stamped(line)):
            received[number], line = pair
        if pending or line.count('"') % 2:  # a quoted cell goes on in the next line
            pending = f"{pending} {line}" if pending else line
            if pending.count('"') % 2:
                continue
            line, pending = pending, ""
        if not line.strip(" \t\x1a"):
            continue
        if line.lstrip().startswith(COMMENTS):
            comments += 1
            if not lines:
                leading.append(line.strip())
            continue
        lines.append(line)
        numbers.append(number)
    if pending:
        raise RecordingError(
            f"{source}: a quotation mark that opens is never closed; correct it or remove all quotation marks."
        )
    if not lines:
        raise RecordingError(f"{source} holds no rows of data; check that the file is complete.")
    labelled = table_of_labels(lines, numbers, least=1 if monitor else 2)
    return _Lines(source, *(labelled or (lines, numbers)), leading, comments, labelled is not None, received)


def _fields(line: str, separator: str) -> list[str]:
    if separator == " ":
        line = re.sub(r"[ \t]+", " ", line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(standard_csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _fields_of(lines: list[str], separator: str) -> list[list[str]]:
    return [_fields(line, separator) for line in lines]


def _sniff(lines: list[str], allow_comma: bool) -> str:
    """The delimiter under which the rows are equally long and most cells are numbers or times."""
    sample = lines[1:60] or lines
    best, best_score = ",", 0.0
    for separator in _DELIMITERS:
        if separator == "," and not allow_comma:
            continue
        rows = _fields_of(sample, separator)
        width = max(set(map(len, rows)), key=[len(row) for row in rows].count)
        if width < 2:
            continue
        cells = [cell for row in rows for cell in row]
        good = sum(
            is_missing(c) or looks_like_time(c) or (is_number(c) and not (separator == "," and "," in c)) for c in cells
        )
        even = sum(len(row) == width for row in rows) / len(rows)
        score = good / len(cells) * even + 0.05 * (separator != " ")
        if score > best_score + 1e-9:
            best, best_score = separator, score
    return best


def _header(
    rows: list[list[str]], header: bool | None, found: _Lines, separator: str, log: list[str], above: int
) -> tuple[list[str] | None, list[str | None] | None, int]:
    """(names or None, units or None, index of the first row of data among `rows`, which begin `above` lines down)."""
    if header is False or (header is None and not is_header(rows[0])):
        names = _commented_header(found, separator, len(rows[0])) if header is None else None
        log.append(
            "Column names from the comment above the data."
            if names
            else "The file names no columns; they are called 0, 1, ..."
        )
        return names, None, 0
    width = len(rows[0])
    units = unit_row(rows[1]) if len(rows) > 1 and len(rows[1]) == width else None
    if units is None:
        return rows[0], None, 1
    log.append(f"Units from line {found.numbers[above + 1]}.")
    return rows[0], units, 2


def _commented_header(found: _Lines, separator: str, width: int) -> list[str] | None:
    if not found.leading or width < 2:
        return None
    names = _fields(found.leading[-1].lstrip("#%/ \t"), separator)
    return names if len(names) == width and all(names) and is_header(names) else None


def _others(lines: Sequence[int]) -> str:
    """Which other lines have another number of cells, as after every restart of a board."""
    if not lines:
        return ""
    listed = ", ".join(str(k) for k in lines[:8])
    many = f" and {len(lines) - 8} more" if len(lines) > 8 else ""
    return f" Line {listed} is so, too." if len(lines) == 1 else f" Lines {listed}{many} are so, too."


def _parse(found: _Lines, first: int, separator: str, width: int, log: list[str]) -> tuple[pl.DataFrame, np.ndarray]:
    lines, numbers = found.lines[first:], found.numbers[first:]
    if separator == " ":
        lines = [re.sub(r"[ \t]+", " ", line.strip()) for line in lines]
    counts = [line.count(separator) + 1 if '"' not in line else len(_fields(line, separator)) for line in lines]
    uneven = [row for row, count in enumerate(counts) if count != width]
    if uneven == [len(lines) - 1] and counts[-1] < width and len(lines) > 1:
        log.append(_cut(numbers[-1]))
        lines, numbers, uneven = lines[:-1], numbers[:-1], []
    if uneven:
        row = uneven[0]
        comma = separator == "," and counts[row] > width
        hint = (
            "if its numbers have decimal commas, separate the columns by semicolons"
            if comma
            else "in Python also delimiter= or skip="
        )
        raise RecordingError(
            f"{found.source}, line {numbers[row]}: {counts[row]} cells where the first row has {width} (delimiter "
            f"{_NAMES.get(separator, separator)!r}); correct or delete the line ({hint})."
            f"{_others([numbers[k] for k in uneven[1:]])}"
        )
    if not lines:
        raise RecordingError(f"{found.source} holds no rows of data below its header; check that the file is complete.")
    quoted = re.compile(rf'(^|{re.escape(separator)})\s+"')
    body = "\n".join(quoted.sub(r'\1"', line) if '"' in line else line for line in lines) + "\n"
    try:
        frame = pl.read_csv(
            io.BytesIO(body.encode()),
            has_header=False,
            separator=separator,
            infer_schema=False,
            new_columns=headings(width),
            quote_char='"',
        )
    except pl.exceptions.PolarsError as error:
        raise RecordingError(
            f"{found.source} cannot be read as a table ({str(error).splitlines()[0]}); "
            "correct the file, or in Python give delimiter= or skip=."
        ) from None
    return frame, np.array(numbers)
