"""What the first rows of a file mean: column names, a row of units, or data at once."""

from collections.abc import Sequence

from plantfit.recording.readers.clock import looks_like_time
from plantfit.recording.readers.numbers import is_missing, is_number
from plantfit.units import known

RUN = 5  # rows that have to be alike where a table begins


def is_header(cells: Sequence[str]) -> bool:
    """Whether a first row names columns: some cell is neither number, time nor missing."""
    return any(not (is_missing(cell) or is_number(cell) or looks_like_time(cell)) for cell in cells)


def unit_row(cells: Sequence[str]) -> list[str | None] | None:
    """Units of a row that holds nothing else (brackets allowed), or None for any other row."""
    units: list[str | None] = []
    for cell in cells:
        text = cell.strip().strip("\"'").strip()
        if text[:1] + text[-1:] in ("[]", "()"):
            text = text[1:-1].strip()
        units.append((text if known(text) or not known(text.lower()) else text.lower()) or None)
    filled = [unit for unit in units if unit]
    named = [unit for unit in filled if unit not in ("-", "1") and not is_missing(unit) and not is_number(unit)]
    if not named or not all(unit in ("-", "1") or (unit in named and known(unit)) for unit in filled):
        return None
    return units


def headings(count: int) -> list[str]:
    """Names of columns that the file does not name: "0", "1", ..."""
    return [str(number) for number in range(count)]


def above_the_table(rows: Sequence[Sequence[str]]) -> int:
    """How many of the first rows are titles and settings that a logger wrote above the header of its table; 0 unless
    that is clear.

    Clear is: five rows (or all that follow) hold numbers or times in the same places, and right above them is a row of
    names, with or without a row of units between.
    """
    width = max(
        (len(row) for row in rows[len(rows) // 2 :]), key=[len(row) for row in rows[len(rows) // 2 :]].count, default=0
    )
    kinds = [[_kind(cell) for cell in row] for row in rows]

    def begins(k: int) -> bool:
        numbers = {"number", "time"} & {*kinds[k]}
        return (
            len(rows[k]) == width > 1 and bool(numbers) and all(_same(kinds[k], other) for other in kinds[k : k + RUN])
        )

    data = next((k for k in range(len(rows) - 2) if begins(k)), 0)
    for head in (data - 2, data - 1):
        between = rows[head + 1 : data]
        if (
            head > 0
            and len(rows[head]) == width
            and _names(rows[head])
            and all(len(r) == width and unit_row(r) for r in between)
        ):
            # a bad row below the header is no title
            return 0 if head == 1 and len(rows[0]) == width and _names(rows[0]) else head
    return 0


def _kind(cell: str) -> str:
    return (
        "missing" if is_missing(cell) else "number" if is_number(cell) else "time" if looks_like_time(cell) else "text"
    )


def _same(one: Sequence[str], other: Sequence[str]) -> bool:
    return len(one) == len(other) and all(a == b or "missing" in (a, b) for a, b in zip(one, other, strict=True))


def _names(row: Sequence[str]) -> bool:
    return len({*row}) == len(row) and all(_kind(cell) == "text" for cell in row if cell) and any(row)


def unique(names: Sequence[str]) -> list[str]:
    """The names, empty ones replaced by their number."""
    return [name.strip() or str(number) for number, name in enumerate(names)]
