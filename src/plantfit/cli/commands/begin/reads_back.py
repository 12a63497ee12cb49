"""A study file that is written reads back: lines that treat what is odd about the clock and the cells of its
recording."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plantfit.cli.commands.begin.study_text import quoted
from plantfit.cli.terminal.out import out
from plantfit.errors import ClockError, PlantfitError, RecordingError

if TYPE_CHECKING:
    from plantfit.recording.readers.columns import Table

_TREATED = {"sort": "times go back", "duplicates": 'times appear twice; "first" keeps the first row of each'}
_WORDS = 8  # different ones among the numbers of a recording: more are no signs of missing values
_SHARE = 0.2  # of the cells of a column, up to which words are such signs


def words_line(content: "Table", headers: Sequence[str], quiet: bool) -> str:
    """A line of the study file, after a line break, by which words among the numbers of columns count as missing; ""
    without such."""
    from plantfit.recording.readers.long_tables import widened
    from plantfit.recording.readers.numbers import words_in

    content = widened(content)
    found: dict[str, int] = {}
    for header in dict.fromkeys(headers):
        column = content.column(header, "a signal")
        own = words_in(content, column)
        if sum(own.values()) > _SHARE * len(column.cells):
            return ""
        for word, count in own.items():
            found[word] = found.get(word, 0) + count
    if not found or len(found) > _WORDS:
        return ""
    cells = f"{sum(found.values())} cell{'s' if sum(found.values()) > 1 else ''}"
    if not quiet:
        words = " or ".join(repr(word) for word in found)
        out.print(f"{cells} with {words} in place of a number: the study file counts them as missing.", markup=False)
    return f"\nmissing = [{', '.join(quoted(word) for word in found)}]  # words in place of a number: {cells}"


def clock_that_reads(text: Callable[[str], str], clock: str, target: Path, quiet: bool) -> str:
    """The line of the clock, with what treats times that go back or stand twice: the file must read back and give a
    problem."""
    from plantfit import spec

    for _ in range(3):
        try:
            spec.parse(text(clock), target)
        except ClockError as error:
            if not error.treatment or error.treatment in clock:
                raise RecordingError(f"{_of_recording(error, target)}.") from error
            clock += f"\n{error.treatment}  # {_TREATED[error.treatment.split()[0]]}"
            if not quiet:
                out.print(
                    f"{_of_recording(error, target).partition('; ')[0]}. The study file treats this with "
                    f"{error.treatment}.",
                    markup=False,
                )
        except PlantfitError as error:  # of a file that the user has not seen
            raise RecordingError(
                "No study file that runs can be made from this recording "
                f"({_of_recording(error, target).splitlines()[0]}); check the names and "
                "values of its columns, or write the file by hand (docs/study-file.md)."
            ) from error
        else:
            break
    return clock


def _of_recording(error: PlantfitError, target: Path) -> str:
    """A sentence about the recording, without the study file that is not written yet."""
    return str(error).removeprefix(f"{target.name}, [recording.data]: ").removesuffix(".")


def checked(text: str, target: Path) -> None:
    """The file must read back and give a problem before it is written."""
    clock_that_reads(lambda clock: text, "", target, quiet=True)
