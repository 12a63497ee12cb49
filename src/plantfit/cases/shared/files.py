"""The study files and recordings of a demo, copied to where the user can change them and run them again."""

from importlib.resources import files
from pathlib import Path

from plantfit.errors import StoreError

KEPT = (".toml", ".csv", ".gz", ".txt", ".md")


def unpack(name: str, folder: str | Path) -> Path:
    """Copy the files of demo `name` into `folder`, replacing earlier copies, and return it.

    Raises StoreError when the folder cannot be written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for entry in files(f"plantfit.cases.{name}").iterdir():
            if entry.name.endswith(KEPT):
                (folder / entry.name).write_bytes(entry.read_bytes())
    except OSError as error:
        raise StoreError(
            f"The folder {str(folder)!r} cannot take the files of "
            f"demo {name!r}: {error.strerror}; choose another folder."
        ) from None
    return folder
