"""`plantfit run --pieces`: the study file with its recordings in pieces, written beside it."""

from pathlib import Path

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.arguments.written_beside import written_beside
from plantfit.cli.terminal.out import said_line


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
    return written_beside(target, text)
