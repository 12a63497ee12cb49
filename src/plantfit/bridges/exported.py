"""`export_plant`: the plant of an answer as files for another program, with its parameters and how its first
recording begins."""

from collections.abc import Callable
from pathlib import Path

from plantfit.answer import Answer
from plantfit.bridges.c_code import c_code
from plantfit.bridges.casadi_functions import casadi_functions
from plantfit.bridges.csv_tables import csv_tables
from plantfit.bridges.fmu.unit import functional_mockup_unit
from plantfit.bridges.inference_draws import inference_draws
from plantfit.bridges.matlab_files import matlab_files
from plantfit.bridges.plain_python import plain_python
from plantfit.bridges.plant import Plant, plant_of, word_of
from plantfit.bridges.python_control import python_control
from plantfit.errors import ModelError, StoreError
from plantfit.folders import may_be_written

_MAKERS: dict[str, Callable[[Plant], dict[str, str | bytes]]] = {
    "python": plain_python, "c": c_code, "casadi": casadi_functions, "control": python_control, "matlab": matlab_files,
    "csv": csv_tables,
    "fmu": functional_mockup_unit,
}  # fmt: skip
# of any model, with its recordings
_OF_ANSWERS: dict[str, Callable[[Answer, str], dict[str, str | bytes]]] = {"arviz": inference_draws}
TARGETS = (*_MAKERS, *_OF_ANSWERS)


def export_plant(
    answer: Answer, to: str, folder: str | Path = ".", name: str | None = None, recording: str | None = None
) -> list[Path]:
    """Write the plant for `to`, one of `TARGETS`, into `folder` and return the files (docs/tuning-controllers.md).

    A file that is there is replaced only where plantfit wrote it. Raises ModelError for a model that the target cannot
    hold, StoreError where a file cannot be written, MissingExtra where a package that writes it is not installed.
    """
    if to not in TARGETS:
        raise ModelError(f"There is no target {to!r} to export to; there are {', '.join(TARGETS)}.")
    if to in _MAKERS:
        files = _MAKERS[to](plant_of(answer, name, recording))
    else:
        files = _OF_ANSWERS[to](answer, word_of(name or answer.problem.name))
    contents = {
        Path(folder) / file: content if isinstance(content, bytes) else content.encode()
        for file, content in files.items()
    }
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        for (place, content), given in zip(contents.items(), files.values(), strict=True):
            # a table names its columns and nobody who wrote it; binaries of all programs begin alike
            if not may_be_written(place, content.partition(b"\n")[0] if isinstance(given, str) else None):
                raise StoreError(
                    f"{place} exists and was not written by plantfit; move it, or choose another folder with --out."
                )
        for place, content in contents.items():
            place.write_bytes(content)
    except OSError as error:
        raise StoreError(
            f"{folder} cannot be written: {error.strerror or error}; choose another folder with --out."
        ) from None
    return list(contents)
