"""Dates with clock readings as loggers write them: ISO, day first, month first, with a decimal comma, with AM and
PM."""

import re
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any, Literal

Order = Literal["ymd", "dmy", "mdy"]
Dates = Literal["day first", "month first", "year first"]
ORDERS: dict[Dates, Order] = {"day first": "dmy", "month first": "mdy", "year first": "ymd"}
UNCLEAR = "day and month can be exchanged in all of its dates"
_LOCAL = re.compile(
    r"(?P<a>\d{1,4})(?P<mark>[./-])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{2,4})[ T,;]+"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,:](?P<part>\d{1,9}))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
)
_DATE = re.compile(r"\d{1,4}([./-])\d{1,2}\1\d{2,4}")


def is_date(cell: str) -> bool:
    """Whether a text is a date without a clock reading."""
    return _DATE.fullmatch(cell.strip()) is not None


def is_timestamp(cell: str) -> bool:
    """Whether a text is a date with a clock reading, in any order of day and month."""
    cell = cell.strip()
    return _iso(cell) is not None or any(_local(cell, order) is not None for order in ("ymd", "dmy", "mdy"))


def timestamps(cells: Sequence[str | None]) -> tuple[list[datetime | None], str | None]:
    """(readings, None where a cell is none; why their times are not known, or None): the first of `readings`."""
    alike = readings(cells)
    return alike[0], UNCLEAR if told_apart(alike) else None


def readings(cells: Sequence[str | None], dates: Dates | None = None) -> list[list[datetime | None]]:
    """What the cells may be, None where a cell is none; several where day and month may be exchanged.

    ISO 8601 is read first. Where day and month may be exchanged, or a year of two digits may come first, the order is
    the one in which every cell is a date; of several, the one in which the record takes least time without going back.
    All that take as little are given; the first is the likeliest. `dates` says the order.
    """
    iso = [_iso(cell or "") for cell in cells]
    if cells and iso[0] is not None:
        return [iso]
    first = _LOCAL.fullmatch((cells[0] or "").strip()) if cells else None
    if first is None:
        return [[None] * len(cells)]
    orders: tuple[Order, ...] = (
        ("ymd",) if len(first["a"]) == 4 else ("dmy",) if first["mark"] == "." else ("mdy", "dmy")
    )
    if len(first["a"]) == 2 == len(first["c"]):  # 24-05-31 may be in May 2024, and not the 24th of May 2031
        orders = (*orders, "ymd")
    if dates is not None:
        orders = (ORDERS[dates],)
    read = {order: [_local(cell or "", order) for cell in cells] for order in orders}
    whole = {order: found for order, found in read.items() if None not in found}
    if len(whole) < 2:
        return [next(iter((whole or read).values()))]
    took = {order: _span(found) for order, found in whole.items()}
    least = min(took.values())
    likely = next(o for o in whole if took[o] == least)
    # a year of two digits comes first where nothing speaks against it, or nowhere
    others = ("mdy", "dmy") if likely != "ymd" else ("ymd",)
    return [whole[o] for o in whole if took[o] == least and o in others]


def told_apart(alike: Sequence[Sequence[Any]]) -> bool:
    """Whether `readings` of the same cells, of which each is a time, differ in the times between rows, and not in the
    date of them alone."""
    firsts = [found[0] for found in alike if found]
    return any(
        (a - start) != (b - other)
        for start, other, found, again in zip(firsts, firsts[1:], alike, alike[1:], strict=False)
        for a, b in zip(found, again, strict=True)
    )


def _span(found: Sequence[datetime | None]) -> timedelta:
    steps = [b - a for a, b in pairwise(found) if a is not None and b is not None]
    return sum((abs(step) for step in steps), timedelta())


def _iso(cell: str) -> datetime | None:
    if not re.match(r"\d{4}-\d\d-\d\d", cell):
        return None
    try:
        return datetime.fromisoformat(cell)
    except ValueError:
        return None


def _local(cell: str, order: str) -> datetime | None:
    found = _LOCAL.fullmatch(cell.strip())
    if found is None:
        return None
    parts = dict(zip(order, (found["a"], found["b"], found["c"]), strict=True))
    if len(parts["d"]) > 2 or len(parts["m"]) > 2 or len(parts["y"]) == 3:
        return None
    hour, half = int(found["hour"]), (found["half"] or "").lower()
    if half:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if half[0] == "p" else 0)
    year = int(parts["y"]) + (2000 if len(parts["y"]) == 2 else 0)
    fraction = (found["part"] or "0").ljust(9, "0")
    try:
        whole = datetime(year, int(parts["m"]), int(parts["d"]), hour, int(found["minute"]), int(found["second"] or 0))
    except ValueError:
        return None
    return whole + timedelta(microseconds=round(int(fraction) / 1000))
