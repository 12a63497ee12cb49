"""Columns as a file holds them, before anyone decides what they mean."""

import difflib
import keyword
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import polars as pl

from plantfit.errors import RecordingError
from plantfit.recording.readers.quantities import quantity_over_unit
from plantfit.units import DIMENSIONLESS, known, of_another_kind

_BRACKETED = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>.*)\))\s*$")


@dataclass(frozen=True, eq=False)  # two columns may hold the same cells
class Column:
    """One column: the text of its header, that text without the unit, the unit, and the cells."""

    header: str
    name: str
    unit: str | None
    cells: pl.Series


@dataclass(frozen=True)
class Table:
    """Columns of equal length. `places` are the line (or row) numbers in the file, `place` their word.

    `decimal` is "auto", "." or ",". `left_out` says why other things of the file are not columns.
    `header` tells whether the columns were named by the file. `period` is what the file calls the seconds between rows,
    and how many. `missing` are words that stand for no value, besides those that always do.
    """

    source: str
    columns: tuple[Column, ...]
    places: Sequence[int] | np.ndarray | None = None
    place: str = "row"
    decimal: str = "auto"
    header: bool = True
    log: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)
    period: tuple[str, float] | None = None
    missing: tuple[str, ...] = ()

    def where(self, row: int) -> str:
        """The file and the line of a row, for messages."""
        number = row + 1 if self.places is None else int(self.places[row])
        return f"{self.source}, {self.place} {number}"

    def column(self, wanted: str | int, purpose: str) -> Column:
        """A column by header, by header without unit, by identifier, or by number from 0."""
        if isinstance(wanted, (int, np.integer)) and not isinstance(wanted, bool):
            if not 0 <= wanted < len(self.columns):
                raise RecordingError(
                    f"{self.source} has no column {wanted} for {purpose}; "
                    f"it has {len(self.columns)} columns, numbered from 0."
                )
            return self.columns[wanted]
        for read in (
            lambda c: c.header,
            lambda c: c.name,
            lambda c: identifier(c.name),
            lambda c: identifier(c.header),
        ):
            found = [c for c in self.columns if read(c) == str(wanted).strip()]
            if len(found) == 1:
                return found[0]
            if found:
                numbers = [self.columns.index(c) for c in found]
                raise RecordingError(
                    f"{self.source} has {len(found)} columns {wanted!r} for {purpose}; choose one by number: {numbers}."
                )
        if wanted in self.left_out:
            raise RecordingError(
                f"{self.source}: {wanted!r} cannot be used for {purpose} because {self.left_out[str(wanted)]}."
            )
        headers = [c.header for c in self.columns]
        raise RecordingError(
            f"{self.source} has no column {wanted!r} for "
            f"{purpose}{close_match(str(wanted), headers)}; it has {headers}."
        )


def close_match(wanted: str, names: Iterable[str]) -> str:
    """A parenthesis " (did you mean ...?)" or nothing; names may have units in brackets."""
    by_lower = {split_header(name)[0].lower(): name for name in names} | {name.lower(): name for name in names}
    close = difflib.get_close_matches(wanted.lower(), by_lower, n=1, cutoff=0.5)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def split_header(header: str) -> tuple[str, str | None]:
    """(name, unit) of "u [V]", "u (V)", "u/V" or "v/(m/s)"; the unit is None when there is something else."""
    found = _BRACKETED.match(header.strip())
    if not found:
        below = header.rpartition("/")[2].strip() if "/" in header else ""
        return quantity_over_unit(header.strip()) or (header.strip(), below if of_another_kind(below) else None)
    unit = (found["square"] if found["square"] is not None else found["round"]).strip()
    if found["round"] is not None and unit in DIMENSIONLESS and unit != "-":
        return header.strip(), None
    if known(unit):
        return found["name"].strip().removesuffix("/").rstrip(), unit
    return header.strip(), unit if of_another_kind(unit) else None


def unknown_unit(header: str) -> str | None:
    """What stands in square brackets at the end of a header, where it has letters and is not a known unit."""
    found = _BRACKETED.match(header.strip())
    text = (found["square"] or "").strip() if found else ""
    return text if re.search(r"[^\W\d]", text) and split_header(header)[1] is None else None


# endings of names that are hardly anything else; of single letters only two, since T_A and x_m may be anything
_ENDINGS = {
    "degC": "degC", "degF": "degF", "rpm": "rpm", "RPM": "rpm", "rad_s": "rad/s", "rad_per_s": "rad/s",
    "deg_s": "deg/s", "m_s": "m/s",
    "rad": "rad", "deg": "deg", "mm": "mm", "cm": "cm", "km": "km", "kg": "kg", "mbar": "mbar", "bar": "bar",
    "kPa": "kPa", "hPa": "hPa",
    "Pa": "Pa", "mV": "mV", "kV": "kV", "V": "V", "mA": "mA", "kW": "kW", "W": "W", "kWh": "kWh", "Hz": "Hz",
    "kHz": "kHz",
    "ohm": "ohm", "pct": "%", "percent": "%", "l_min": "l/min", "lpm": "l/min", "m3_h": "m^3/h", "l_h": "l/h",
}  # fmt: skip
_ENDED = re.compile(rf".*[^_\W]_(?P<unit>{'|'.join(sorted(_ENDINGS, key=len, reverse=True))})")


def unit_in_name(name: str) -> str | None:
    """The unit that a name without brackets ends in, as in "temp1_degC"; None where it ends in none that is sure."""
    found = _ENDED.fullmatch(name.strip())
    return _ENDINGS[found["unit"]] if found else None


def identifier(name: str) -> str:
    """The name with everything that a formula cannot hold replaced by underscores."""
    clean = re.sub(r"\W+", "_", name).strip("_")
    if not clean:
        return "c"
    if not clean.isidentifier():
        clean = f"c{clean}"
    return f"{clean}_" if keyword.iskeyword(clean) else clean


def cells_of(name: str, array: np.ndarray) -> pl.Series:
    """An array (n,) as cells; dates and durations of any resolution, objects as they are read one by one."""
    if array.dtype.kind in "mM" and np.datetime_data(array.dtype)[0] not in ("ms", "us", "ns"):
        array = array.astype(f"{array.dtype.kind}8[us]")
    return pl.Series(name, array.tolist() if array.dtype == object else array, strict=False)


def named_columns(
    headers: Iterable[str], cells: Iterable[pl.Series], units: Iterable[str | None] | None = None
) -> tuple[Column, ...]:
    """Columns from header texts; a unit row, where there is one, wins over nothing but an absent bracket."""
    headers, cells = list(headers), list(cells)
    rows = list(units) if units is not None else [None] * len(headers)
    columns = []
    before = [header.partition("/")[0].strip() if "/" in header else None for header in headers]
    for header, series, row_unit, first in zip(headers, cells, rows, before, strict=True):
        # several things behind the same word are a path (pump/A, pump/B), and no units
        name, unit = split_header(header) if first is None or before.count(first) == 1 else (header.strip(), None)
        columns.append(Column(header.strip(), name, unit if unit is not None else row_unit, series))
    return tuple(columns)
