"""The quick way through long tables of plain numbers: polars reads the bytes at once; whatever is unusual is left to
csv.py."""

from dataclasses import dataclass

import polars as pl

from plantfit.recording.readers.formats.text.header import headings
from plantfit.recording.readers.numbers import is_missing, is_number

SHORTEST = 1 << 20  # bytes of a file for which a second way is worth its while
HEAD = 1 << 16  # bytes that are looked at line by line
ENOUGH = 64  # lines of the head: more than csv.py looks at to find delimiter, header and units


@dataclass(frozen=True)
class Plain:
    """A frame of the rows of data, the line of the first one counted from 1, and the line at the end that was cut,
    if there is one."""

    frame: pl.DataFrame
    first: int
    cut: int | None


def head_of(data: bytes) -> str | None:
    """The whole lines in the first bytes of a long file as text, None where the file has to be read line by line."""
    if len(data) < SHORTEST:
        return None
    end = data.rfind(b"\n", 0, HEAD) + 1
    try:
        head = data[:end].decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    return None if not head or "\0" in head or head.count("\r") != head.count("\r\n") else head


def plain_frame(data: bytes, rows: list[list[str]], first: int, separator: str) -> Plain | None:
    """The rows of data from line `first` (counted from 1) on, or None if a line could be anything but a row of them.

    `rows` are the first of them, cell by cell. Columns in which all of these are numbers become Float64, others text. A
    frame that is returned holds what csv.py would read: every other case (quotes, comments, empty lines, uneven rows,
    cells that are no numbers in a column of numbers, decimal commas) returns None.
    """
    width, mark = len(rows[0]), separator.encode()
    start = _start_of_line(data, first)
    if separator == " " or width < 2 or start is None or any(len(row) != width for row in rows):
        return None
    end = len(data)
    while end > start and data[end - 1 : end] in (b"\n", b"\r", b" ", b"\x1a"):  # what follows the last row
        end -= 1
    kinds = [all(is_missing(row[k]) or _is_plain(row[k]) for row in rows) for k in range(width)]
    if not all(kinds) and _unusual(data, start, end, mark):  # where all cells have to be numbers polars refuses these
        return None
    lines, cut = data.count(b"\n", start, end) + 1, None
    last = data.rfind(b"\n", start, end) + 1
    if last > start and data.count(mark, last, end) < width - 1:  # a recording that ended in the middle of a line
        cut, end, lines = first + lines - 1, last - 1, lines - 1
    top = data[:start].replace(b"\r", b"").removeprefix(b"\xef\xbb\xbf")
    # versions of polars count empty lines differently
    whole = end + 2 >= len(data) and not top.startswith(b"\n") and b"\n\n" not in top
    names = headings(width)
    schema = {name: pl.Float64 if kind else pl.String for name, kind in zip(names, kinds, strict=True)}
    try:
        frame = pl.read_csv(
            data if whole else data[start:end],
            has_header=False,
            skip_rows=first - 1 if whole else 0,
            separator=separator,
            schema=schema,
            quote_char=None,
            null_values=_spellings(rows) or None,
        )
    except (pl.exceptions.PolarsError, UnicodeDecodeError):
        return None
    if frame.height != lines:  # empty lines
        return None
    if frame.to_series(width - 1).null_count() and data.count(mark, start, end) != lines * (width - 1):
        return None  # what polars takes for an empty cell may be a short row; longer ones it has refused
    return Plain(frame, first, cut)


def _unusual(data: bytes, start: int, end: int, mark: bytes) -> bool:
    """Whether there are bytes that could be quotes, comments, lone returns or decimal commas."""
    if any(data.find(byte, start, end) >= 0 for byte in (b'"', b"#", b"%")):
        return True
    if data.find(b"/", start, end) >= 0 and data.find(b"//", start, end) >= 0:
        return True
    if data.find(b"\r", start, end) >= 0 and data.count(b"\r", start, end) != data.count(b"\r\n", start, end):
        return True
    return mark != b"," and data.find(b",", start, end) >= 0


def _start_of_line(data: bytes, number: int) -> int | None:
    """Where a line begins, counted from 1; None beyond the head."""
    at = 0
    for _ in range(number - 1):
        at = data.find(b"\n", at, HEAD) + 1
        if not at:
            return None
    return at


def _is_plain(cell: str) -> bool:
    return is_number(cell) and "," not in cell


def _spellings(rows: list[list[str]]) -> list[str]:
    """How the first rows write that a value is missing, where they do not leave it empty."""
    return sorted({cell for row in rows for cell in row if cell and is_missing(cell)})
