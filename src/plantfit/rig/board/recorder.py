"""Record from a board: play an excitation, keep every sample, mark what is missing, stop the motor whatever happens."""

import math
import os
import time
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path

from plantfit.errors import BoardError, RecordingError
from plantfit.recording.readers.columns import identifier
from plantfit.recording.record import Recording
from plantfit.rig.board.part_file import PartFile, refuse_existing
from plantfit.rig.board.pilot import Loop, Pilot
from plantfit.rig.board.playback import Playback, raw_values, timing
from plantfit.rig.board.protocol import FINISHED, WATCHDOG, Board, Sample
from plantfit.rig.board.recorded import Progress, Recorded
from plantfit.rig.board.rows import Rows
from plantfit.rig.board.session import GREET_SECONDS, Session
from plantfit.units import known

BAUD = 1_000_000
_STALL_SECONDS = 0.5  # without a good line, after which the port is opened again
_RETRY_SECONDS = 0.2
_WATCH_SECONDS = 0.25


def record(
    port: str,
    out: str | os.PathLike[str],
    excitation: Recording | None = None,
    *,
    duration: float | None = None,
    rate: float | None = None,
    baud: int = BAUD,
    reconnect: float = 30.0,
    force: bool = False,
    stopping: Callable[[], bool] = lambda: False,
    watch: Callable[[Progress], None] | None = None,
    loop: Loop | None = None,
) -> Recorded:
    """Record from the board on `port` into the table `out`, playing `excitation` (its drive's signal, else its first)
    meanwhile.

    A `loop` in its place lets a controller on this computer drive the board, until its set points end or `duration` is
    over.

    Ends after the excitation, after `duration` (s), or when `stopping()` says so; the motor is
    stopped first. `rate`: samples a second, the board's fastest if left out. A port that goes away
    or stalls is opened again for up to `reconnect` seconds, and playing goes on where it broke off.
    `watch` is called a few times a second.

    Rows hold t [s] on the board's clock, the drive held from then on, the channels, the board's
    counter, and gap: 1 in rows whose sample did not come, empty else. Rows are on disk within a
    second, in OUT.part until the end. Raises BoardError, RecordingError, MissingExtra.
    """
    if loop is not None and excitation is not None:
        raise RecordingError(
            "Both an excitation and a controller are to drive the board; give the set points to the controller."
        )
    if loop is not None:
        rate, duration = rate or 1.0 / loop.period, duration or loop.seconds
    for name, value in (("rate", rate), ("duration", duration), ("baud", baud), ("reconnect", reconnect)):
        if value is not None and not value > 0:
            raise RecordingError(f"record: {name} is {value:g}; give a number above 0.")
    refuse_existing(Path(out), force)
    session = Session(port, baud)
    try:
        board = session.connect(GREET_SECONDS, stopping)
        _check_board(board)
        divide, hold = timing(board, excitation, rate)
        _check_load(board, board.tick_hz / divide, baud)
        values = [] if excitation is None else raw_values(excitation, board)
        pilot = None if loop is None else Pilot(loop, board, divide)
        rows = Rows(board, divide / board.tick_hz, None if pilot is None else pilot.column)
        story = [
            f"Recorded from board {board.name!r} (firmware {board.firmware}) "
            f"at {board.tick_hz / divide:g} samples a second."
        ]
        story += [] if loop is None else [loop.sentence]
        made = [] if excitation is None else takewhile(lambda line: not line.startswith("Read from"), excitation.log)
        story += [f"Played: {line}" for line in made]
        file = PartFile(out, rows.header, story, force)
        run = _Run(session, rows, file, Playback(values, board.buffer), (divide, hold), reconnect, duration, pilot)
        return run.to_the_end(story, stopping, watch)
    finally:
        session.drop()


class _Run:
    """The loop of one recording and what it keeps between rounds."""

    def __init__(
        self,
        session: Session,
        rows: Rows,
        file: PartFile,
        playback: Playback,
        pace: tuple[int, int],
        reconnect: float,
        duration: float | None,
        pilot: Pilot | None = None,
    ):
        self.session, self.rows, self.file, self.playback, self.pace = session, rows, file, playback, pace
        self.reconnect, self.duration, self.pilot = reconnect, duration, pilot
        self.reconnects = self.resets = 0
        self.finished, self.restart, self.fresh = False, False, 0
        self.latest: list[Sample] = []
        self.came = time.monotonic()  # when the last sample came
        self.began, self.watched = self.came, 0.0

    def to_the_end(
        self, story: list[str], stopping: Callable[[], bool], watch: Callable[[Progress], None] | None
    ) -> Recorded:
        failure: BaseException | None = None
        try:
            self._start()
            while not (self.finished or stopping()):
                self._round(stopping)
                self._show(watch)
        except BaseException as error:  # the motor stops and the file is kept, whatever it was; then it goes on
            failure = error
        stopped = self.session.stop()
        self._take()
        counter, counts = self.session.ended or (None, [0, 0, 0, 0])
        if counter is not None:
            self.file.add(self.rows.end(counter))
        told = self._told(stopped, counts)
        if self.file.error is not None:
            self.file.close()
        if self.rows.received == 0:
            self.file.discard()
            if failure is None:
                failure = BoardError(
                    f"The board on {self.session.port} sent no sample; check the cable and record again."
                )
        else:
            self.file.finish((*story, *told.log))
        if failure is not None:
            raise failure
        return told

    def _start(self) -> None:
        """Start, or start again, where the excitation stands; a line that fails is left for the next round."""
        self._take()  # what came before, so that nothing after the start is taken for it
        elapsed_from = self.came
        counter = self.session.start(*self.pace, self.playback)
        if counter is None:
            return self.session.drop()
        if self.rows.next is None:
            self.rows.begin(counter)
        elif self.restart:
            self.file.add(self.rows.rebooted(counter, time.monotonic() - elapsed_from))
            self.restart = False
        self.came = time.monotonic()
        self.fresh = counter
        if self.pilot is not None:
            self.pilot.begin(counter)

    def _round(self, stopping: Callable[[], bool]) -> None:
        if self.file.error is not None:
            raise self.file.failed(self.file.error)
        if not self.session.up:
            return self._connect_again(stopping)
        self.session.pump()
        watchdog = self._take()
        if self.session.up and time.monotonic() - max(self.session.heard, self.came) > _STALL_SECONDS:
            return self.session.drop()
        if watchdog or self.restart or self.rows.next is None:
            return self._start()
        self.session.feed()
        if self.duration is not None and self.rows.t >= self.duration:
            self.finished = True

    def _take(self) -> bool:
        """Samples to rows; True where the board's watchdog has stopped the motor and playing is to go on."""
        watchdog, taken = False, self.session.samples
        while taken:
            sample = taken.popleft()
            current = (sample.counter - self.fresh) % 2**32 < 2**31  # made after the last start
            if self.pilot is not None and current:
                self.pilot.take(sample, self.rows.t + self.rows.period)
                self.rows.wanted = self.pilot.wanted
            self.file.add(self.rows.take(sample))
            self.latest.append(sample)
            self.came = time.monotonic()
            if current and sample.index >= 0:
                self.playback.played(sample.index)
            watchdog |= current and sample.state == WATCHDOG
            if current and sample.state == FINISHED:
                self.finished = True
                self.playback.played(len(self.playback.values) - 1)  # also those whose samples were lost
        if self.pilot is not None and (raw := self.pilot.command()) is not None and not watchdog:
            self.session.drive(raw)
        return watchdog

    def _connect_again(self, stopping: Callable[[], bool]) -> None:
        """Open the port again and go on; BoardError when it stays away for too long."""
        before = self.session.board
        until = self.came + self.reconnect
        while not stopping():
            try:
                board = self.session.connect(max(0.5, min(GREET_SECONDS, until - time.monotonic())), stopping)
                break
            except BoardError as error:
                if time.monotonic() > until:
                    raise BoardError(
                        f"The board on {self.session.port} was lost after {self.rows.t:.1f} s and did not come "
                        f"back within {self.reconnect:g} s ({error}) What came before is in {str(self.file.out)!r}."
                    ) from None
                time.sleep(_RETRY_SECONDS)
        else:
            return
        self.reconnects += 1
        if before is not None and not before.same_kind(board):
            self.session.drop()
            raise BoardError(
                f"Another board ({board.name!r}) is now on {self.session.port}; what came before is in "
                f"{str(self.file.out)!r}."
            )
        if before is not None and before.boot != board.boot:
            self.resets += 1
            self.restart = True

    def _show(self, watch: Callable[[Progress], None] | None) -> None:
        now = time.monotonic()
        if now - self.watched < _WATCH_SECONDS:
            return
        self.watched = now
        latest, self.latest = tuple(self.latest), []
        if watch is not None:
            rows, lines = self.rows, self.session.lines
            watch(
                Progress(
                    rows.board, max(rows.t, 0.0), rows.received, rows.lost, lines.garbled, self.reconnects,
                    self.session.up,
                    self.playback.position, len(self.playback.values), latest,
                )
            )  # fmt: skip

    def _told(self, stopped: bool, counts: list[int]) -> Recorded:
        rows, (dropped, refused, starved, watchdogs) = self.rows, counts
        garbled = self.session.lines.garbled
        log = [
            f"{rows.received} samples came, {rows.lost} were lost in {rows.gaps} gaps; {garbled} lines were garbled."
        ]
        if self.reconnects:
            log.append(f"The port was opened again {self.reconnects} times; the board was reset {self.resets} times.")
        if starved or watchdogs:
            log.append(
                f"The board stopped the motor {watchdogs} times because this "
                f"machine was silent, {starved} times for want of values."
            )
        if self.playback.values:
            log.append(f"{self.playback.position} of {len(self.playback.values)} values of the excitation were played.")
        if self.pilot is not None:
            log.append(self.pilot.told)
        log.append(
            "The board acknowledged the stop."
            if stopped
            else "The board did not acknowledge the stop; its watchdog stops the motor."
        )
        return Recorded(
            self.file.out, rows.board, max(rows.t, 0.0), rows.received, rows.lost, rows.gaps, garbled, refused, dropped,
            starved,
            watchdogs, self.reconnects, self.resets, stopped, self.playback.position, len(self.playback.values),
            tuple(log),
        )  # fmt: skip


def _check_board(board: Board) -> None:
    """Raise BoardError for a board whose declarations cannot become a recording."""
    if min(board.tick_hz, board.buffer, board.drive.limit) <= 0:
        raise BoardError(
            f"Board {board.name!r} declares {board.tick_hz} ticks a second, a buffer of {board.buffer} "
            f"values and a drive limit of {board.drive.limit}; all must be above 0: correct its firmware."
        )
    for part in (board.drive, *board.channels):
        if (
            not (math.isfinite(part.scale) and part.scale != 0)
            or identifier(part.name) != part.name
            or (part.unit and not known(part.unit))
        ):
            raise BoardError(
                f"Board {board.name!r} declares {part.name!r} in {part.unit!r} with scale {part.scale:g}; "
                "a plain name, a known unit and a scale other than 0 are needed: correct its firmware."
            )


def _check_load(board: Board, rate: float, baud: int) -> None:
    """Raise BoardError where the line is too slow for `rate` samples a second."""
    bits = 10 * rate * (38 + 6 * len(board.channels))  # a line of usual length, ten bits a byte
    if bits > baud:
        raise BoardError(
            f"{rate:g} samples a second need about {bits:.0f} baud and the port runs at {baud}; "
            f"choose --rate up to {baud / bits * rate:.0f} or a higher --baud."
        )
