"""A study file is read here: its keys and values are checked before anything large is imported, so that a slip is
told at once."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from plantfit.errors import SpecError, in_words
from plantfit.spec.limits import check_tables
from plantfit.spec.tables import validated

if TYPE_CHECKING:
    from plantfit.spec.study import Study


def load(path: str | Path) -> "Study":
    """Read a study file.

    Raises SpecError with file, key, value and what to do, and the errors of the rooms that use the values.
    """
    path = Path(path)
    return parse(read_text(path), path)


def read_text(path: Path) -> str:
    """The text of a study file. Raises SpecError where there is none, or none that can be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        from plantfit.recording.readers.files import similar_file

        names = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        near = similar_file(path.name, names)
        raise SpecError(
            f"There is no study file {str(path)!r}.{f' Did you mean {near!r}?' if near else ''} Make one with "
            "`plantfit init RECORDING.csv`."
        ) from None
    except IsADirectoryError:
        raise SpecError(f"{str(path)!r} is a folder; name a study file in it.") from None
    except UnicodeDecodeError as error:
        raise SpecError(
            f"The study file {str(path)!r} is not UTF-8 text (byte {error.start}); save it as UTF-8."
        ) from None
    except (OSError, ValueError) as error:
        raise SpecError(
            f"The study file {str(path)!r:.300} cannot be read: {error}; check the name and your rights."
        ) from None


def parse(text: str, path: str | Path = "study.toml", files: Mapping[str, Path] | None = None) -> "Study":
    """The same from a text; recordings are looked for beside `path`, or where `files` says."""
    path = Path(path)
    table = validated(text, path)
    if any(t.file is not None for t in table.model.tables.values()):
        from plantfit.spec.characteristics import with_characteristics

        table = with_characteristics(table, path, files or {})
    check_tables(table, path)
    from plantfit.spec.study import study_of  # jax, after the file has been understood

    try:
        return study_of(table, text, path, files or {})
    except (OverflowError, RecursionError) as error:
        raise SpecError(
            f"{path.name}: a number is too large, or there are too many brackets inside each other "
            f"({in_words(error)}); correct it."
        ) from error
