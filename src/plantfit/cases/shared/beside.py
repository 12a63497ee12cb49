"""A part of a demo in a process of its own, on a core that the rest leaves free."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, TypeVar

from plantfit import collector
from plantfit.errors import SimulationError

T = TypeVar("T")


class Beside(Generic[T]):
    """`function(*arguments)`, both from modules that can be imported, in a process of its own; leaving the context
    ends it."""

    def __init__(self, function: Callable[..., T], *arguments: Any):
        # a plain command, because multiprocessing would run the user's script again
        name = function.__name__
        command = f"from {__name__} import answer_pipe; from {function.__module__} import {name}; answer_pipe({name})"
        self._process = subprocess.Popen(
            [sys.executable, "-c", command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self._name = name
        self._reader = ThreadPoolExecutor(1)
        self._answer = self._reader.submit(self._process.communicate, pickle.dumps(arguments))

    def result(self) -> T:
        """Waits for it. Raises SimulationError with what the process said where it failed."""
        out, error = self._answer.result()
        if self._process.returncode:
            said = (error.decode(errors="replace").strip().splitlines() or ["no word"])[-1]
            raise SimulationError(f"The part {self._name} failed in a process of its own ({said}); run the demo again.")
        return pickle.loads(out)

    def __enter__(self) -> "Beside[T]":
        return self

    def __exit__(self, *_: Any) -> None:
        if self._process.poll() is None:
            self._process.terminate()
        self._reader.shutdown()


def answer_pipe(function: Callable[..., Any]) -> None:
    """What `function` makes of the pickled arguments at standard input, pickled to standard output."""
    out = sys.stdout.buffer
    sys.stdout = sys.stderr  # nothing else may be written there
    collector.seldom()
    out.write(pickle.dumps(function(*pickle.loads(sys.stdin.buffer.read()))))
    collector.left()
