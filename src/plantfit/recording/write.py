"""A recording to a text table that `read_csv` reads back to the last bit."""

import csv as standard_csv
import gzip
import io
import os
from pathlib import Path

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.readers.columns import identifier, split_header
from plantfit.recording.readers.formats.text.csv import LOG_MARK
from plantfit.recording.record import Recording


def to_csv(recording: Recording, path: str | os.PathLike[str]) -> Path:
    """Write times, signals with units in the header, and the log as comments; `.gz` compresses.

    Missing samples become empty cells. Raises RecordingError for names that could not be read back.
    """
    file = Path(path)
    headers = ["t [s]", *(_header(recording, name) for name in recording.signals)]
    text = io.StringIO()
    text.writelines(f"{LOG_MARK}{' '.join(sentence.split())}\n" for sentence in recording.log)
    writer = standard_csv.writer(text, lineterminator="\n")
    writer.writerow(headers)
    columns = [recording.t, *(signal.values for signal in recording.signals.values())]
    cells = [["" if np.isnan(value) else repr(value) for value in column.tolist()] for column in columns]
    writer.writerows(zip(*cells, strict=True))
    data = text.getvalue().encode()
    try:
        file.write_bytes(gzip.compress(data, mtime=0) if file.suffix == ".gz" else data)
    except OSError as error:
        raise RecordingError(
            f"File {str(file)!r} cannot be written ({error.strerror}); choose another place."
        ) from None
    return file


def _header(recording: Recording, name: str) -> str:
    unit = recording.signals[name].unit
    header = name if unit is None else f"{name} [{unit}]"
    if split_header(header) != (name, unit) or identifier(name) != name:
        raise RecordingError(
            f"Recording {recording.name!r}: signal {name!r} with unit {unit!r} "
            "could not be read back; use a plain name and a known unit."
        )
    return header
