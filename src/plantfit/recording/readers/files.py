"""Finding a file, and its bytes as text."""

import difflib
import gzip
import os
from collections.abc import Iterable
from pathlib import Path

from plantfit.errors import RecordingError

SIMILAR = 0.75  # of all letters of two names, that they share in their order: two letters of eight may differ


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there; raises RecordingError with close matches from its folder."""
    file = Path(path)
    try:
        file.lstat()
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:  # too long, a NUL, no right to look
        raise RecordingError(
            f"File {str(file)!r:.200} cannot be read ({getattr(error, 'strerror', None) or error})."
        ) from None
    if file.is_file():
        return file
    if file.is_dir():
        raise RecordingError(f"{str(file)!r} is a folder; name a file in it.")
    if not file.parent.is_dir():
        raise RecordingError(f"File {str(file)!r} does not exist, nor does its folder; check the path.")
    near = similar_file(file.name, (entry.name for entry in file.parent.iterdir() if entry.is_file()))
    hint = f" (did you mean {near!r}?)" if near else ""
    raise RecordingError(f"File {str(file)!r} does not exist{hint}; check the path.")


def similar_file(name: str, names: Iterable[str]) -> str | None:
    """Of the names of files the most similar one to a name that is none of them: by what stands before the ending, as
    the ending alone makes no two names similar; None where none is."""
    by_stem: dict[str, str] = {}
    for other in sorted(names):
        stem = _stem(other)
        if stem not in by_stem or Path(other).suffix.casefold() == Path(name).suffix.casefold():
            by_stem[stem] = other  # of equals the one with the ending that was asked for
    close = difflib.get_close_matches(_stem(name), by_stem, n=1, cutoff=SIMILAR)
    return by_stem[close[0]] if close else None


def _stem(name: str) -> str:
    stem = name.removesuffix(".gz")
    return stem.rpartition(".")[0].casefold() or stem.casefold()


def read_bytes(file: Path) -> bytes:
    """The bytes of a file, gzip or not. Raises RecordingError."""
    try:
        data = file.read_bytes()
        return gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
    except (OSError, EOFError) as error:
        raise RecordingError(
            f"File {str(file)!r} cannot be read ({error}); check that it is complete and may be read."
        ) from None


def decoded(data: bytes, file: Path) -> tuple[str, str]:
    """(text, encoding) of the bytes of a text file: UTF-8 or UTF-16 with or without mark, else Latin-1."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace"), "UTF-16"
    if b"\x00" in data[:4096] or data[:4] == b"PK\x03\x04":
        raise RecordingError(
            f"File {file.name!r} is not text; save it as CSV, or give its name "
            "the ending of its format, such as .xlsx, .mat, .parquet or .npz."
        )
    try:
        return data.decode("utf-8-sig"), "UTF-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "Latin-1"
