"""A table that grows on disk while it is recorded: nothing older than half a second is only in memory."""

import os
import queue
import shutil
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from plantfit.errors import RecordingError
from plantfit.recording.readers.formats.text.csv import LOG_MARK

SYNC_SECONDS = 0.5


class PartFile:
    """Rows go to OUT.part, from a thread of its own so that a slow disk does not hold up the port; `finish` makes it
    OUT.

    Raises RecordingError where OUT or OUT.part exists (unless `force`) or cannot be written. A crash leaves OUT.part,
    which `read_csv` reads.
    """

    def __init__(self, out: str | os.PathLike[str], header: str, log: Sequence[str], force: bool = False):
        self.out = Path(out)
        self.part = part_of(self.out)
        refuse_existing(self.out, force)
        try:
            self._file = self.part.open("w" if force else "x", encoding="utf-8", newline="")
        except OSError as error:
            raise RecordingError(
                f"File {str(self.part)!r} cannot be written ({error.strerror}); choose another place."
            ) from None
        self.error: OSError | None = None
        self._body = _told(log).encode()
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._queue.put(_told(log) + header + "\n")
        self._thread = threading.Thread(target=self._write, name="plantfit-part-file", daemon=True)
        self._thread.start()

    def add(self, rows: list[str]) -> None:
        """Queue rows, without line feeds."""
        if rows:
            self._queue.put("\n".join(rows) + "\n")

    def finish(self, log: Sequence[str]) -> Path:
        """Write what is left, put `log` at the top and give the file its name. Raises RecordingError; OUT.part is
        kept then."""
        self.close()
        whole = self.out.with_name(self.out.name + ".whole")
        try:
            with self.part.open("rb") as source, whole.open("wb") as target:
                source.seek(len(self._body))
                target.write(_told(log).encode())
                shutil.copyfileobj(source, target, 1 << 20)
                target.flush()
                os.fsync(target.fileno())
            os.replace(whole, self.out)
            self.part.unlink()
        except OSError as error:
            whole.unlink(missing_ok=True)
            raise self.failed(error) from None
        return self.out

    def close(self) -> None:
        """Write what is left and keep OUT.part. Raises RecordingError where the disk refused."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        if self.error is not None:
            raise self.failed(self.error) from None

    def discard(self) -> None:
        """Nothing was recorded: leave no file."""
        self.close()
        self.part.unlink(missing_ok=True)

    def failed(self, error: OSError) -> RecordingError:
        """The sentence for a disk that refused."""
        return RecordingError(
            f"{str(self.part)!r} could not be continued ({error.strerror}); what was "
            "recorded until then is kept in it: free some space and record again."
        )

    def _write(self) -> None:
        text: str | None = ""
        try:
            with self._file as file:
                while text is not None:
                    pieces = [text := self._queue.get()]
                    # gather: fsync for every row would wear the disk
                    time.sleep(SYNC_SECONDS if text is not None else 0)
                    while not self._queue.empty():
                        pieces.append(text := self._queue.get())
                    file.write("".join(p for p in pieces if p))
                    file.flush()
                    os.fsync(file.fileno())
        except OSError as error:
            self.error = error


def part_of(out: Path) -> Path:
    """Where rows go while recording."""
    return out.with_name(out.name + ".part")


def refuse_existing(out: Path, force: bool) -> None:
    """Raise RecordingError where a recording would be overwritten, or its folder does not exist."""
    if not out.parent.is_dir():
        raise RecordingError(f"Folder {str(out.parent)!r} does not exist; create it or choose another place.")
    for file in (out, part_of(out)):
        if file.exists() and not force:
            left = (
                "is left from a recording that did not end; rename it to keep it"
                if file != out
                else "exists; choose another name"
            )
            raise RecordingError(f"File {str(file)!r} {left}, or overwrite it with --force.")


def _told(log: Sequence[str]) -> str:
    return "".join(f"{LOG_MARK}{' '.join(sentence.split())}\n" for sentence in log)
