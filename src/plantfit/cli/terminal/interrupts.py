"""Ctrl-C, seen at once whatever the main thread does.

Python runs its signal handlers between bytecodes of the main thread, so not while XLA compiles or LLVM optimises, and
an exception that one raises inside a callback of jax is lost. So the C part of the handler writes into a socket, and a
thread that reads it acknowledges, and ends the process where the main thread does not.
"""

import _thread
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from plantfit.errors import Interrupted

EXIT_CODE = 130
GRACE = 0.7  # seconds that the main thread gets to end by itself
COALESCED = 0.2  # seconds after which the main thread is asked whether it saw a second signal
LAST_GRACE = 5.0  # the same where it has to leave a machine in a safe state
SENTENCE = (
    "Stopped by {cause}. `plantfit resume` goes on with a study, `plantfit report` shows one that is done; "
    "begin anything else anew."
)

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopping:
    """Whether Ctrl-C was pressed in a part of a command that saves before it ends; `before_exit` is done when it
    ends at once."""

    def __init__(self, sentence: str, farewell: Callable[[], str], cleans_up: bool):
        self.sentence, self.farewell, self.cleans_up = sentence, farewell, cleans_up
        self.before_exit: list[Callable[[], object]] = []
        self.asked, self.seen, self.told = False, 0, 0
        self.interrupted = False  # once: what cleans up is not interrupted in it

    def __call__(self) -> bool:
        return self.asked


class _Watch:
    """What the signal handler and the thread know."""

    def __init__(self) -> None:
        self.stopping: Stopping | None = None
        self.sentence = SENTENCE
        self.number = signal.SIGINT  # of the last signal
        self.ending = threading.Event()  # the main thread has noticed and says so itself
        self.over = threading.Event()

    def on_signal(self, number: int, frame: object) -> None:
        """In the main thread, when it comes to it."""
        part, self.number = self.stopping, signal.Signals(number)
        if part is None:
            raise KeyboardInterrupt
        part.seen += 1
        part.asked = True
        if part.seen > 1 and part.cleans_up:
            if part.interrupted:
                return
            part.interrupted = True
            raise KeyboardInterrupt
        if part.seen > 1:
            end(part.farewell(), part.before_exit)

    def listen(self, line: socket.socket) -> None:
        """In the thread, at once."""
        with suppress(OSError):
            while (numbers := line.recv(64)) and 0 not in numbers:
                for number in numbers:
                    if number in _SIGNALS:
                        self.number = signal.Signals(number)
                        self.hit()

    def hit(self) -> None:
        part = self.stopping
        if part is None:
            threading.Thread(
                target=self.end_after, args=(GRACE, lambda: with_cause(self.sentence)), daemon=True
            ).start()
            return
        part.asked = True
        part.told += 1
        if part.told == 1:
            _say(part.sentence)
        elif part.cleans_up:
            if part.told == 2:
                threading.Thread(target=self.end_after, args=(LAST_GRACE, part.farewell), daemon=True).start()
                threading.Thread(target=self.interrupt, args=(part,), daemon=True).start()
        else:
            end(part.farewell(), part.before_exit)

    def interrupt(self, part: Stopping) -> None:
        """Two signals that came before the main thread looked are one to Python: send more until it has seen one."""
        while not self.ending.wait(COALESCED) and not part.interrupted:
            if sys.platform == "win32":
                _thread.interrupt_main()
            else:
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    def end_after(self, seconds: float, sentence: Callable[[], str]) -> None:
        if not self.ending.wait(seconds):
            end(sentence())
        elif not self.over.wait(LAST_GRACE):  # it has said so, but something holds it up
            os._exit(EXIT_CODE)


_watch: _Watch | None = None
_ENDS = threading.Lock()


@contextmanager
def watched() -> Generator[None]:
    """Inside, Ctrl-C is acknowledged within a second; elsewhere than in the main thread nothing is changed."""
    global _watch
    if _watch is not None or threading.current_thread() is not threading.main_thread():
        yield
        return
    here, there = socket.socketpair()
    there.setblocking(False)
    _watch = watch = _Watch()
    before = [signal.signal(s, watch.on_signal) for s in _SIGNALS]
    descriptor = signal.set_wakeup_fd(there.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=watch.listen, args=(here,), daemon=True)
    thread.start()
    unraisable = sys.unraisablehook
    sys.unraisablehook = lambda lost: None if issubclass(lost.exc_type, KeyboardInterrupt) else unraisable(lost)
    try:
        yield
    finally:
        sys.unraisablehook = unraisable
        watch.ending.set()
        watch.over.set()
        signal.set_wakeup_fd(descriptor)
        for s, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(s, handler)
        _watch = None
        with suppress(OSError):
            there.send(b"\0")
        thread.join(1.0)
        here.close()
        there.close()


@contextmanager
def stoppable(
    sentence: str = "Stopping: saving what is done. Ctrl-C again stops at once.",
    farewell: Callable[[], str] = lambda: "Stopped at once.",
    *,
    cleans_up: bool = False,
) -> Generator[Stopping]:
    """Inside, the first Ctrl-C says `sentence` and is told by the yielded function. A second one says `farewell` and
    ends the process at once; where the main thread `cleans_up` it gets KeyboardInterrupt and some seconds to do so."""
    with watched():
        watch, part = _watch, Stopping(sentence, farewell, cleans_up)
        if watch is None:  # not in the main thread: nobody asks
            yield part
            return
        before, watch.stopping = watch.stopping, part
        try:
            yield part
        finally:
            watch.stopping = before


@contextmanager
def saying(sentence: str) -> Generator[None]:
    """What is said where a signal ends what is done inside, with {cause} for its name: as Interrupted, or by the thread
    where it has to end the process."""
    watch = _watch
    before = SENTENCE if watch is None else watch.sentence
    if watch is not None:
        watch.sentence = sentence
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(with_cause(sentence)) from None
    finally:
        if watch is not None:
            watch.sentence = before


def with_cause(sentence: str) -> str:
    """A sentence whose {cause} is what ended the process: Ctrl-C, or a signal by its name."""
    number = signal.SIGINT if _watch is None else _watch.number
    return sentence.replace("{cause}", "Ctrl-C" if number == signal.SIGINT else f"the signal {number.name}")


def ending() -> None:
    """The main thread is about to end by itself and says so."""
    if _watch is not None:
        _watch.ending.set()


def end(sentence: str, before: list[Callable[[], object]] | tuple[()] = ()) -> None:
    """End this process now, from any thread: one sentence and the exit code of Ctrl-C."""
    if not _ENDS.acquire(blocking=False):  # the other thread is at it
        threading.Event().wait(LAST_GRACE)
    for step in before:
        with suppress(Exception):
            step()
    # a live line may have hidden the cursor
    clean = "\r\x1b[K\x1b[?25h" if sys.stderr is not None and os.isatty(2) else ""
    with suppress(OSError):
        os.write(2, f"{clean}plantfit: {sentence}\n".encode())
    os._exit(EXIT_CODE)


def _say(sentence: str) -> None:
    from plantfit.cli.terminal.out import warn

    with suppress(OSError, ValueError):
        warn(sentence)
