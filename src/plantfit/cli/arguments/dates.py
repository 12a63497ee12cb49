"""--dates: the order of day and month in time stamps, for a recording that no study file describes yet."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from plantfit.errors import RecordingError, SpecError

if TYPE_CHECKING:
    from plantfit.recording.description import Description
    from plantfit.recording.readers.timestamps import Dates


def order(dates: str | None) -> "Dates | None":
    """The order of day and month; raises SpecError for another."""
    from plantfit.recording.readers.timestamps import ORDERS

    for known in ORDERS:
        if known == dates:
            return known
    if dates is not None:
        raise SpecError(f"--dates {dates!r}: write one of {', '.join(map(repr, ORDERS))}.")
    return None


@contextmanager
def asked_as_option() -> Generator[None]:
    """Errors of reading that ask for the order of day and month name the option, and not a key of a study file that
    is not there."""
    from plantfit.recording.readers.clock import ORDER_WANTED

    try:
        yield
    except RecordingError as error:
        if ORDER_WANTED not in str(error):
            raise
        told = str(error).replace(ORDER_WANTED, 'give --dates "day first" or --dates "month first"')
        raise RecordingError(told) from error


def check_used(dates: str | None, found: "Description") -> None:
    """Raises RecordingError where the times of a file cannot be used, and SpecError where they are no dates and
    `dates` is given."""
    from plantfit.recording.readers.numbers import is_number

    if found.problem:
        with asked_as_option():
            raise RecordingError(found.problem)
    first = next((c.first for c in found.columns if c.header == found.time), ())
    if dates is not None and (found.time is None or is_number(next(iter(first), ""))):
        raise SpecError(f"--dates {dates!r}: the times of {found.file} are no dates; leave it out.")
