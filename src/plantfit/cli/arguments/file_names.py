"""Names of studies as names of files, and what a command may write over; asked before anything runs."""

import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path

from plantfit.errors import SearchError

LONGEST = 120  # bytes; file systems allow 255 with ending and temporary name
_WINDOWS = {"con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(10))}


def file_name(name: str, ending: str) -> str:
    """The file of a study in the current folder: the name without what would be a path, a hidden file or no file at
    all."""
    # a surrogate alone is in no file name
    kept = unicodedata.normalize("NFC", name.encode("utf-8", "replace").decode())
    kept = re.sub(r"[^\w .,+=()\[\]@%~^-]+", "-", kept)  # no separators, colons, quotes, wildcards, control characters
    kept = kept.encode()[:LONGEST].decode(errors="ignore").lstrip("~ .-").rstrip(" .-")
    if kept.split(".")[0].strip().lower() in _WINDOWS:
        kept = f"study {kept}"
    return f"{kept or 'study'}.{ending}"


def report_places(names: Iterable[str], place: str | None) -> list[Path]:
    """Where the reports of studies go: `place`, or a file each in the current folder.

    Raises SearchError where two would be one file, StoreError where one cannot be written or is a file of something
    else.
    """
    names = list(names)
    if place is not None and len(names) > 1:
        raise SearchError(
            f"--out {place} names one report, but there are {len(names)} studies; leave it out, each gets NAME.html."
        )
    places = [Path(file_name(name, "html") if place is None else place) for name in names]
    folded = [str(p).casefold() for p in places]  # as file systems of Windows and macOS compare names
    for name, file in zip(names, places, strict=True):
        same = folded.count(str(file).casefold())
        if same > 1:
            raise SearchError(
                f"{same} of the studies, {name!r} among them, would write the report {file}; rename or run one alone."
            )
    from plantfit.report.html import check_place  # jinja2, after the study files were understood

    for file in places:
        check_place(file)
    return places
