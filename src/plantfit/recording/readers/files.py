"""Finding a file, and its bytes as text."""

import gzip
import os
from pathlib import Path

from plantfit.errors import RecordingError
from plantfit.recording.readers.columns import close_match


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
    hint = close_match(file.name, sorted(entry.name for entry in file.parent.iterdir() if entry.is_file()))
    raise RecordingError(f"File {str(file)!r} does not exist{hint}; check the path.")


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
