"""A text table that grows while it is read: a logger's file, or standard input."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.readers.formats.text.csv import csv_table
from plantfit.recording.record import Recording

CONTEXT = (
    30  # rows that are read again with new ones, so that header, decimal marks and the kind of time are found alike
)
ENOUGH = 12  # rows from which the first ones are read


class Source(Protocol):
    """Where bytes come from."""

    def read(self) -> bytes | None:
        """What has come since the last look; empty where nothing has."""
        ...


class GrowingTable:
    """Rows of a table as they come; `read` makes a recording of a file with the same header, as
    `plantfit.recording.read` does.

    Lines without an end wait for it. Times go on from those read before, also where the reader counts from the first
    row.
    """

    def __init__(self, source: Source, read: Callable[[Path], Recording], name: str = "recording"):
        self.source, self.read, self.name = source, read, name
        self.rest = b""
        self.waiting: list[bytes] = []  # complete lines that are not read yet
        self.top: list[bytes] = []  # the lines above the first row
        self.tail: list[bytes] = []
        self.times = np.zeros(0)  # of the rows in `tail`
        self.rows = 0

    def poll(self, last: bool = False) -> Recording | None:
        """The rows that have come since; None where there are none, or too few to begin with. With `last` nothing
        waits.

        Raises RecordingError for rows that cannot be read.
        """
        self._take(last)
        if not self.waiting or (self.rows == 0 and len(self.waiting) < ENOUGH and not last):
            return None
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{self.name}.csv"
            file.write_bytes(b"".join([*self.top, *self.tail, *self.waiting]))
            if self.rows == 0:
                places = csv_table(file).places
                first = 0 if places is None else int(places[0]) - 1
                self.top, self.waiting = self.waiting[:first], self.waiting[first:]
            recording = self.read(file)
        return self._new(recording)

    def _take(self, last: bool) -> None:
        *lines, self.rest = (self.rest + (self.source.read() or b"")).split(b"\n")
        if last and self.rest.strip():
            lines, self.rest = [*lines, self.rest], b""
        begun = self.rows > 0
        self.waiting += [line + b"\n" for line in lines if line.strip() or not begun]

    def _new(self, recording: Recording) -> Recording | None:
        t, known = np.asarray(recording.t, dtype=float), len(self.times)
        if known:
            t = t + (self.times[0] - t[0])
            new = np.flatnonzero(t > self.times[-1] + 1e-9 * max(1.0, abs(self.times[-1])))
            if len(new) < len(t) - known:
                at = t[known] if len(t) > known else t[-1]
                raise RecordingError(
                    f"{self.name}: a row at {at:.6g} s came after one at {self.times[-1]:.6g} "
                    "s; times have to grow, so begin anew for another recording."
                )
        else:
            new = np.arange(len(t))
        lines = [*self.tail, *self.waiting]
        self.tail, self.waiting = lines[-CONTEXT:], []
        self.rows += len(new)
        kept = t[-len(self.tail) :]
        self.times = kept
        if len(kept) < len(self.tail):
            self.tail = self.tail[-len(kept) :]
        if not len(new):
            return None
        signals = {n: type(s)(s.values[new], s.unit) for n, s in recording.signals.items()}
        return Recording(t[new], signals, recording.name, recording.log, recording.clocked)
