"""Logs of a serial monitor, which writes before every line when it came: 12:04:00.000 -> 213."""

from collections.abc import Iterable, Sequence
from itertools import islice

from plantfit.recording.readers.clock import is_time_name, looks_like_time

ARROW = "->"
SOME = 50  # lines that tell the kind of a file
MOST_OF = 0.8  # of them, which have a time


def stamped(line: str) -> tuple[str, str] | None:
    """The time before the arrow and what came then, None of another line."""
    time, arrow, rest = line.partition(ARROW)
    return (time.strip(), rest) if arrow and looks_like_time(time.strip()) else None


def is_received(lines: Iterable[str]) -> bool:
    """Whether a text is the log of a serial monitor."""
    first = list(islice((line for line in lines if line.strip()), SOME))
    return sum(stamped(line) is not None for line in first) >= max(MOST_OF * len(first), 1)


def name_of_stamps(names: Sequence[str] | None) -> str:
    """The column of these times: "time", but a clock of the board itself is the better one and is taken then."""
    return "received" if any(is_time_name(name.partition("[")[0].strip()) for name in names or ()) else "time"
