"""What the first rows of a file mean: column names, a row of units, or data at once."""

from collections.abc import Sequence

from plantfit.recording.readers.clock import looks_like_time
from plantfit.recording.readers.numbers import is_missing, is_number
from plantfit.units import known


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
        units.append(text or None)
    filled = [unit for unit in units if unit]
    named = [unit for unit in filled if unit not in ("-", "1") and not is_missing(unit) and not is_number(unit)]
    if not named or not all(unit in ("-", "1") or (unit in named and known(unit)) for unit in filled):
        return None
    return units


def headings(count: int) -> list[str]:
    """Names of columns that the file does not name: "0", "1", ..."""
    return [str(number) for number in range(count)]


def unique(names: Sequence[str]) -> list[str]:
    """The names, empty ones replaced by their number."""
    return [name.strip() or str(number) for number, name in enumerate(names)]
