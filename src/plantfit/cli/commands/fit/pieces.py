"""`plantfit run --pieces`: the study file with its recordings in pieces, written beside it."""

import shlex
from pathlib import Path

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.understand.diagnose import shown
from plantfit.cli.terminal.out import said_line
from plantfit.errors import SpecError


def cut(path: str, seconds: float, json: bool) -> str:
    """The study file in pieces of so many seconds, named from here; one that is there is kept if it says the same.

    Raises SpecError for a study that cannot be cut so, and for another file in its place.
    """
    from plantfit import spec

    study = spec.load(path)
    with said_line(json) as say:
        if say is not None:
            say(f"{study.name}: joins segments of each record loosely, to see where pieces begin")
        text = spec.in_pieces(study, seconds)
    target = study.path.with_name(f"{Path(file_name(study.name, 'toml')).stem}-in-pieces.toml")
    if not target.exists():
        try:
            target.write_text(text, encoding="utf-8")
        except OSError as error:
            raise SpecError(f"{target} cannot be written ({error.strerror}); make its folder writable, or copy the study file.") from None
    elif target.read_text(encoding="utf-8", errors="replace") != text:
        run = f"plantfit run {shlex.quote(shown(target))}"
        raise SpecError(f"{shown(target)!r} exists already and says something else; run it with `{run}`, or move it away.")
    return shown(target)
