"""Parsers in C and Rust that end the process at some broken files are tried in another process first."""

import atexit
import json
import os
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path

from plantfit.errors import RecordingError

SECONDS = 60.0  # a file of some GiB takes less
_TRY = """
import json, sys
for line in sys.stdin:
    kind, path = json.loads(line)
    try:
        if kind == "mat":
            from scipy.io import loadmat
            loadmat(path, simplify_cells=True)
        else:
            import polars
            polars.read_parquet_metadata(path)
            polars.read_parquet(path)
    except BaseException:  # it is said by the process that reads it in earnest
        pass
    sys.stdout.write("ended\\n")
    sys.stdout.flush()
"""


class _Helper:
    """A process that tries one file after the other; another one takes its place when it has ended."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None
        self.owner, self.lock = 0, threading.Lock()

    def ends(self, kind: str, file: Path) -> bool | None:
        """Whether reading ends with a result or an exception; False if the process ended with it, None if time ran
        out."""
        with self.lock:
            if self.process is None or self.owner != os.getpid() or self.process.poll() is not None:
                self.process, self.owner = self._started(), os.getpid()
            process = self.process
            assert process.stdin is not None
            assert process.stdout is not None
            late = threading.Event()
            watch = threading.Timer(SECONDS, lambda: (late.set(), process.kill()))
            watch.start()
            try:
                process.stdin.write(json.dumps([kind, str(file.resolve())]) + "\n")
                process.stdin.flush()
                ended = process.stdout.readline() == "ended\n"
            except OSError:
                ended = False
            finally:
                watch.cancel()
            if not ended:
                self.stop()
            return True if ended else None if late.is_set() else False

    def _started(self) -> "subprocess.Popen[str]":
        words = [sys.executable, "-I", "-c", _TRY]
        quiet = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        atexit.register(self.stop)
        # of its own session: Ctrl-C is for the process that asks
        return subprocess.Popen(words, start_new_session=True, **quiet)

    def stop(self) -> None:
        process, self.process = self.process, None
        if process is None or self.owner != os.getpid():
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:  # what was not written yet
                    continue


@cache
def _helper() -> _Helper:
    return _Helper()


def crash(kind: str, file: Path) -> str | None:
    """What the reader of a kind of file does at this one instead of ending: "crashes" or "does not end"; None if it
    ends."""
    if not sys.executable:
        return None
    try:
        ended = _helper().ends(kind, file)
    except OSError:  # no process can be made here
        return None
    return None if ended else "does not end" if ended is None else "crashes"


def check(kind: str, file: Path) -> None:
    """Raise RecordingError for a file ("mat", "parquet") at which the reader of scipy or polars crashes or does not
    end.

    Found by tests/fuzz: broken MATLAB files end scipy 1.17 by a signal, and broken Parquet files polars 2.1 by an
    allocation of exbibytes.
    """
    why = crash(kind, file)
    if why is None:
        return
    named, again = ("a MATLAB file", "save it anew with '-v7'") if kind == "mat" else ("Parquet", "write it anew")
    raise RecordingError(f"{file.name} is damaged: reading it as {named} {why}; {again}.")
