"""What a database driver says, as one sentence a user can act on."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError

from plantfit.errors import StoreError

KEPT = "finished runs are kept"

_SENTENCES = {
    "SQLITE_BUSY": f"is locked by another program; close that program and try again ({KEPT}).",
    "SQLITE_LOCKED": f"is locked by another program; close that program and try again ({KEPT}).",
    "SQLITE_READONLY": "cannot be written; allow writing to the file and its folder, or copy it elsewhere.",
    "SQLITE_PERM": "cannot be written; allow writing to the file and its folder, or copy it elsewhere.",
    "SQLITE_FULL": f"cannot grow because the disk is full; free some space and resume the study ({KEPT}).",
    "SQLITE_CANTOPEN": "cannot be opened; check that it is a file and that you may read and write its folder.",
    "SQLITE_CORRUPT": "is damaged; restore it from a copy, or move it away and start the study again.",
    "SQLITE_NOTADB": "is not a study database; choose another file, or move this one away.",
    "SQLITE_IOERR": f"could not be read or written by the disk; check the disk, then resume the study ({KEPT}).",
}


@contextmanager
def translated(name: str) -> Iterator[None]:
    """Turn driver errors raised inside into StoreError about the database `name`."""
    try:
        yield
    except DBAPIError as error:
        raise StoreError(f"Study database {name} {_sentence(error.orig)}") from error
    except sqlite3.Error as error:
        raise StoreError(f"Study database {name} {_sentence(error)}") from error


@contextmanager
def readable(name: str, study_id: int) -> Iterator[None]:
    """Turn rows that cannot be decoded inside into StoreError."""
    try:
        yield
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise StoreError(
            f"Study {study_id} in {name} has a row that cannot be read ({error}); restore the file from a copy, or delete the study."
        ) from error


def _sentence(error: BaseException | None) -> str:
    code, text = str(getattr(error, "sqlite_errorname", "")), str(error).strip()
    for known, sentence in _SENTENCES.items():
        if code.startswith(known):
            return sentence
    if text.startswith(("no such column", "no such table")):
        return f"lacks a table or column ({text}); it was changed by another program, so restore it from a copy."
    first_line = "".join(text.splitlines()[:1])
    return f"answered {first_line!r}; check its address, the server and your rights, then resume the study ({KEPT})."
