"""What a database driver says, as one sentence a user can act on."""

import sqlite3
import zlib
from collections.abc import Generator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError

from plantfit.errors import StoreError, in_words
from plantfit.study.store.addresses import concealed

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
    "SQLITE_IOERR": f"cannot be read or written, because the disk failed; check the disk, then resume the study "
    f"({KEPT}).",
}


# by SQLSTATE, or its first two characters: https://www.postgresql.org/docs/current/errcodes-appendix.html
_SERVER_SENTENCES = {
    "55P03": f"is locked by another program; close that program and try again ({KEPT}).",
    "25006": "cannot be written; it is open for reading only, so write to another server or change that setting.",
    "42501": "cannot be used with your rights; ask its owner to grant you the tables, or choose another database.",
    "28": "refused the user or the password; check both in the address.",
    "3D000": "does not exist on the server; make it with `createdb`, or check the address.",
    "53100": f"cannot grow because the disk of the server is full; "
    f"free some space there and resume the study ({KEPT}).",
    "53300": f"has no connection left for this process; use fewer workers or raise max_connections ({KEPT}).",
    "57P": f"is not answering because the server stops or starts; resume the study when it is back ({KEPT}).",
    "XX001": "is damaged on the server; restore it from a copy, or choose another database.",
    "XX002": "is damaged on the server; restore it from a copy, or choose another database.",
    "42P01": "lacks a table; it was changed by another program, so restore it from a copy.",
    "42703": "lacks a column; it was changed by another program, so restore it from a copy.",
}
UNREACHABLE = "08"


@contextmanager
def translated(name: str, address: str = "") -> Generator[None]:
    """Turn driver errors raised inside into StoreError about the database `name`; passwords of its `address` are in
    none of them."""
    try:
        yield
    except DBAPIError as error:
        for one in (error, error.orig):
            if one is not None:
                one.args = tuple(concealed(a, address) if isinstance(a, str) else a for a in one.args)
        raise StoreError(f"Study database {name} {concealed(_sentence(error.orig), address)}") from error
    except sqlite3.Error as error:
        raise StoreError(f"Study database {name} {_sentence(error)}") from error
    except (
        UnicodeDecodeError
    ) as error:  # sqlite3 cannot say what is wrong, because the words of a broken schema stand in it
        raise StoreError(f"Study database {name} {_SENTENCES['SQLITE_CORRUPT']}") from error


@contextmanager
def readable(name: str, study_id: int) -> Generator[None]:
    """Turn rows that cannot be decoded inside into StoreError."""
    try:
        yield
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError, zlib.error) as error:
        raise StoreError(
            f"Study {study_id} in {name} has a row that cannot be read "
            f"({in_words(error)}); restore the database from a copy, or delete the study."
        ) from error


def _sentence(error: BaseException | None) -> str:
    code, text = str(getattr(error, "sqlite_errorname", "")), str(error).strip()
    for known, sentence in _SENTENCES.items():
        if code.startswith(known):
            return sentence
    if text.startswith(("duplicate column", "no such index")) or text.endswith("already exists"):
        return f"was changed by another program ({text}); restore it from a copy."
    if text.startswith(("no such column", "no such table")):
        return f"lacks a table or column ({text}); it was changed by another program, so restore it from a copy."
    state = str(getattr(error, "sqlstate", None) or _state_by_text(text))
    for known, sentence in _SERVER_SENTENCES.items():
        if state.startswith(known):
            return sentence
    first_line = "".join(text.splitlines()[:1])
    if state == UNREACHABLE:
        return (
            f"cannot be reached ({first_line}); check its address and "
            f"that the server runs, then resume the study ({KEPT})."
        )
    return f"answered {first_line!r}; check its address, the server and your rights, then resume the study ({KEPT})."


def _state_by_text(text: str) -> str:
    """Before there is a connection the driver knows no SQLSTATE."""
    if "authentication failed" in text or ("role " in text and "does not exist" in text):
        return "28"
    if "database " in text and "does not exist" in text:
        return "3D000"
    if "too many clients" in text or "connection slots" in text:
        return "53300"
    if "is starting up" in text or "is shutting down" in text:
        return "57P"
    return (
        UNREACHABLE if text.startswith(("connection ", "consuming input failed", "server closed", "could not")) else ""
    )
