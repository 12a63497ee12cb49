"""Study files that a command writes beside the one that it was given."""

import shlex
from pathlib import Path

from plantfit.errors import SpecError


def shown(target: Path) -> str:
    """A file as a command would name it from here."""
    return str(target.relative_to(Path.cwd()) if target.is_absolute() and target.is_relative_to(Path.cwd()) else target)


def write(target: Path, text: str, otherwise: str) -> None:
    """Raises SpecError where the file cannot be written, which ends in what to do `otherwise`."""
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SpecError(f"{str(target)!r} cannot be written ({error.strerror}); {otherwise}.") from None


def written_beside(target: Path, text: str) -> str:
    """The file, named from here; one that is there is kept if it says the same. Raises SpecError for another file in
    its place."""
    if not target.exists():
        write(target, text, "make its folder writable, or copy the study file to one that is")
    elif target.read_text(encoding="utf-8", errors="replace") != text:
        run = f"plantfit run {shlex.quote(shown(target))}"
        raise SpecError(
            f"{shown(target)!r} exists already and says something else; run it with `{run}`, or move it away."
        )
    return shown(target)
