"""A part of a demo in a process of its own, on a core that the rest leaves free."""

import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, Generic, TypeVar

from plantfit import collector
from plantfit.errors import SimulationError

T = TypeVar("T")
OFTEN = 0.5  # s between what is told while the answer is awaited
TOLD, ANSWER = "told", "answer"  # what a pickle of the pipe holds


class Beside(Generic[T]):
    """`function(*arguments, progress)`, both from modules that can be imported, in a process of its own; leaving the
    context ends it."""

    def __init__(self, function: Callable[..., T], *arguments: Any):
        # a plain command, because multiprocessing would run the user's script again
        name = function.__name__
        command = f"from {__name__} import answer_pipe; from {function.__module__} import {name}; answer_pipe({name})"
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  closed with the context
        self._process = subprocess.Popen(
            [sys.executable, "-c", command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said
        )
        self._name = name
        self._told: Any = None
        self._answer: list[T] = []
        self._reader = threading.Thread(target=self._converse, args=(arguments,), daemon=True)
        self._reader.start()

    def _converse(self, arguments: tuple[Any, ...]) -> None:
        """Hands the arguments over, and keeps what is told last and the answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError, EOFError, pickle.UnpicklingError):  # it has ended: `result` says how
            with self._process.stdin as pipe:
                pipe.write(pickle.dumps(arguments))
            while not self._answer:
                kind, thing = pickle.load(self._process.stdout)
                if kind == ANSWER:
                    self._answer.append(thing)
                else:
                    self._told = thing
        self._process.wait()

    def result(self, progress: Callable[[Any], None] | None = None) -> T:
        """Waits for it, and gives `progress` what it tells meanwhile.

        Raises SimulationError with what the process said where it failed.
        """
        while self._reader.is_alive():
            self._reader.join(OFTEN)
            if progress is not None and self._told is not None and self._reader.is_alive():
                progress(self._told)
        if not self._answer:
            self._said.seek(0)
            said = (self._said.read().decode(errors="replace").strip().splitlines() or ["no word"])[-1]
            raise SimulationError(f"The part {self._name} failed in a process of its own ({said}); run the demo again.")
        return self._answer[0]

    def __enter__(self) -> "Beside[T]":
        return self

    def __exit__(self, *_: Any) -> None:
        if self._process.poll() is None:
            self._process.terminate()
        self._reader.join()
        self._said.close()


def answer_pipe(function: Callable[..., Any]) -> None:
    """What `function` makes of the pickled arguments at standard input, pickled to standard output behind what it
    tells of its progress."""
    out = sys.stdout.buffer
    sys.stdout = sys.stderr  # nothing else may be written there
    collector.seldom()
    tell = _Teller(out)
    tell.write(ANSWER, function(*pickle.loads(sys.stdin.buffer.read()), tell))
    collector.left()


class _Teller:
    """A `progress` that writes to a pipe; searches may call it from threads of their own."""

    def __init__(self, out: IO[bytes]):
        self._out, self._lock = out, threading.Lock()

    def __call__(self, told: Any) -> None:
        self.write(TOLD, told)

    def write(self, kind: str, thing: Any) -> None:
        content = pickle.dumps((kind, thing))
        with self._lock:
            self._out.write(content)
            self._out.flush()
