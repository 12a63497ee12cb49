"""Where plantfit keeps what is quicker read than made, and which files of the user it may replace."""

import os
import stat
import warnings
from functools import cache
from pathlib import Path

from plantfit.errors import PlantfitWarning


def cache_folder() -> Path:
    """The user's cache folder for plantfit (`PLANTFIT_CACHE`, else `XDG_CACHE_HOME`, else ~/.cache)."""
    own = os.environ.get("PLANTFIT_CACHE")
    if own:
        return Path(own)
    place = os.environ.get("XDG_CACHE_HOME")
    return Path(place or os.path.expanduser("~/.cache")) / "plantfit"  # Path.home() raises where there is none


def may_be_written(path: Path, start: bytes | None = None) -> bool:
    """Whether no file is lost by writing `path`: there is none, or one that plantfit wrote (it says so, or begins
    with `start`)."""
    if not path.exists():
        return True
    if not path.is_file():
        return False
    held = path.read_bytes()
    return b"plantfit" in held or (start is not None and held.startswith(start))


@cache
def code_folder(kind: str) -> Path | None:
    """The folder of compiled code of a kind, made for this user alone; None where there can be none or others can write
    to it.

    Whoever writes to it runs code as this user, so one that is not safe is not used, and that is said.
    """
    whole = cache_folder().absolute()
    folder = whole / kind
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        open_to_others = next((f for f in (whole, folder) if not _is_own(f)), None)
    except OSError:
        return None  # a read-only home costs time only
    if open_to_others is None:
        return folder
    said_once(
        f"The cache folder {open_to_others} can be written by other users, so no compiled code is taken from it or "
        f"kept in it; make it yours alone with `chmod go-w {open_to_others}`, or set PLANTFIT_CACHE to another folder."
    )
    return None


def said_once(sentence: str) -> None:
    """Warn with a sentence, once in this process."""
    if sentence not in _SAID:
        _SAID.add(sentence)
        warnings.warn(sentence, PlantfitWarning, stacklevel=2)


_SAID: set[str] = set()


def _is_own(folder: Path) -> bool:
    """Whether only this user (and root) can write to a folder. On Windows the rights of the user's folder say so."""
    if os.name != "posix":
        return True
    facts = folder.stat()
    return facts.st_uid in (0, os.getuid()) and not facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
