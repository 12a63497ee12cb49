"""A conversation with a board: greet, start, feed, stop; it survives a port that stalls or goes away."""

import time
from collections import deque
from collections.abc import Callable

from plantfit.errors import BoardError
from plantfit.rig.board import protocol
from plantfit.rig.board.link import Link, LinkDown
from plantfit.rig.board.playback import Playback
from plantfit.rig.board.protocol import Board, Hello, Lines, Sample, encode

GREET_SECONDS = 4.0  # boards that reset when the port opens need about two
_REPEAT_SECONDS = 0.1
_ALIVE_SECONDS = 0.05
_PAUSE_SECONDS = 0.004  # between two looks at the port
_STOP_TRIES = 10


class Session:
    """Owns the port. Samples wait in `samples` in the order they came; `ended` is (counter, counts) once the stop
    was acknowledged."""

    def __init__(self, port: str, baud: int):
        self.port, self.baud = port, baud
        self.lines, self.samples = Lines(), deque[Sample]()
        self.board: Board | None = None
        self.playback: Playback | None = None
        self.command: int | None = None  # of a controller, in steps of the drive
        self.ended: tuple[int, list[int]] | None = None
        self.heard = 0.0  # when the last good line came
        self._link: Link | None = None
        self._hello = Hello()
        self._held: deque[Sample] | None = None  # samples that came before a new hello, which tells whose they are
        self._started: int | None = None  # counter from the acknowledgement of `start`
        self._number = int(time.time()) & 0x3FFFFFFF
        self._written = 0.0

    @property
    def up(self) -> bool:
        """Whether the port is open and was good when last used."""
        return self._link is not None

    def connect(self, seconds: float, stopping: Callable[[], bool] = lambda: False) -> Board:
        """Open the port and greet the board, for up to `seconds` or until `stopping()`.

        Raises BoardError where it cannot be opened, is silent, or speaks otherwise.
        """
        self.drop()
        self._link = Link(self.port, self.baud)
        self._hello, self._held = Hello(), deque()
        received, good = self.lines.received, self.lines.good
        until, again = time.monotonic() + seconds, 0.0
        while (board := self._hello.board()) is None:
            now = time.monotonic()
            if not self.up or now > until or stopping():
                self.drop()
                raise BoardError(self._silence(self.lines.received - received, self.lines.good - good))
            if now > again:
                self._write(encode("H", protocol.VERSION))
                again = now + 3 * _REPEAT_SECONDS
            self.pump()
        same = self.board is not None and self.board.boot == board.boot
        if same or self.board is None:
            self.samples.extend(self._held)
        self._held, self.board = None, board
        return board

    def start(self, divide: int, hold: int, playback: Playback) -> int | None:
        """Start sampling, and playing from `playback.position`; the counter of the first sample, None where the line
        fails."""
        self._number, self._started, self.playback, self.command = self._number + 1, None, playback, None
        line = encode("S", self._number, divide, hold, len(playback.values), playback.position)
        until, again = time.monotonic() + 2.0, 0.0
        while self._started is None:
            now = time.monotonic()
            if not self.up or now > until:
                return None
            if now > again:
                self._write(line)
                again = now + _REPEAT_SECONDS
            self.pump()
        playback.begin(self._number, time.monotonic())
        return self._started

    def feed(self) -> None:
        """Send what the board's buffer can take, and a sign of life where nothing else was sent."""
        now = time.monotonic()
        due = self.playback.due(now) if self.playback else b""
        if due or now - self._written > _ALIVE_SECONDS:
            alive = encode("W", self._number) if self.command is None else encode("V", self._number, self.command)
            self._write(due or alive)

    def drive(self, raw: int) -> None:
        """What the motor is to get from now on; said again as a sign of life."""
        self.command = raw
        self._write(encode("V", self._number, raw))

    def stop(self) -> bool:
        """Stop the motor; True once the board has acknowledged it."""
        for _ in range(_STOP_TRIES):
            if not self.up:
                return False
            self._write(encode("X", self._number))
            until = time.monotonic() + _REPEAT_SECONDS
            while self.ended is None and self.up and time.monotonic() < until:
                self.pump()
            if self.ended is not None:
                return True
        return False

    def drop(self) -> None:
        """Close the port; what was begun of a line is lost."""
        if self._link is not None:
            self._link.close()
            self._link = None
        self.lines.broken_off()

    def pump(self) -> None:
        """Wait a little, read what came and sort it."""
        time.sleep(_PAUSE_SECONDS)
        if self._link is None:
            return
        try:
            data = self._link.read()
        except LinkDown:
            return self.drop()
        for fields in self.lines.feed(data):
            self._sort(fields)

    def _sort(self, fields: list[str]) -> None:
        self.heard = time.monotonic()
        try:
            if fields[0] == "D":
                (self.samples if self._held is None else self._held).append(Sample.read(fields))
            elif fields[0] in ("H", "A", "C"):
                self._hello.take(fields, self.port)
            elif fields[:2] == ["K", "U"] and self.playback:
                self.playback.acknowledged(int(fields[2]), int(fields[3]), self.heard)
            elif fields[:2] == ["K", "S"] and int(fields[2]) == self._number:
                self._started = int(fields[3])
            elif fields[0] == "E" and self.command is not None and "unknown" in fields[1]:
                raise BoardError(
                    f"The board on {self.port} takes no commands of a controller; "
                    "flash the firmware that comes with this plantfit."
                )
            elif fields[:2] == ["K", "X"] and int(fields[2]) == self._number:
                self.ended = int(fields[3]), [int(f) for f in fields[4:8]]
        except (ValueError, IndexError):
            raise BoardError(
                f"The board on {self.port} sent {','.join(fields)!r}, whose checksum is right but "
                "which the protocol does not know; flash the firmware that comes with this plantfit."
            ) from None

    def _write(self, data: bytes) -> None:
        if self._link is not None:
            self._written = time.monotonic()
            try:
                self._link.write(data)
            except LinkDown:
                self.drop()

    def _silence(self, received: int, good: int) -> str:
        if received == 0:
            return (
                f"The board on {self.port} does not answer; check its power, "
                "that plantfit's firmware is on it, and that this is its port."
            )
        if good == 0:
            return (
                f"Port {self.port} sends bytes but no line of the protocol at {self.baud} baud; "
                "choose the firmware's rate with --baud, or check that this is its port."
            )
        return (
            f"The board on {self.port} answers but its hello does not come "
            "through; check the cable, or lower the baud on both sides."
        )
