"""Values sent ahead of time into the board's buffer, again and again until they are acknowledged."""

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.clean.sampling import signal_of, uniform_period
from plantfit.recording.record import Recording
from plantfit.rig.board.protocol import Board, encode
from plantfit.units import convert

_RESEND_SECONDS = 0.08
_MOST_VALUES = 16  # in a line


class Playback:
    """Go-back-N: `want` is what the board asked for last, `sent` what is under way."""

    def __init__(self, values: list[int], buffer: int):
        self.values, self._buffer = values, buffer
        # a board with little memory also receives few bytes while it is busy: 128 values are an Arduino Uno's 64 bytes
        self._chunk, self._lines = max(1, min(_MOST_VALUES, buffer // 32)), max(1, buffer // 128)
        self.session = self.want = self.sent = self.position = 0
        self._progress = 0.0

    def begin(self, session: int, now: float) -> None:
        """The board starts at `position`, with an empty buffer."""
        self.session, self.want, self.sent, self._progress = session, self.position, self.position, now

    def acknowledged(self, session: int, want: int, now: float) -> None:
        """The board has all values before `want`."""
        if session == self.session and self.want < want <= len(self.values):
            self.want, self._progress = want, now
            self.sent = max(self.sent, want)

    def played(self, index: int) -> None:
        """The board applied value `index`."""
        self.position = max(self.position, index + 1)

    def due(self, now: float) -> bytes:
        """Lines to send now, perhaps none."""
        if self.sent > self.want and now - self._progress > _RESEND_SECONDS:
            self.sent, self._progress = self.want, now
        stop = min(len(self.values), self.position + self._buffer, self.want + self._lines * self._chunk)
        if self.sent == self.want:
            self._progress = now
        lines = []
        while self.sent < stop and (stop - self.sent >= self._chunk or stop == len(self.values)):
            end = min(self.sent + self._chunk, stop)
            lines.append(encode("U", self.session, self.sent, *self.values[self.sent : end]))
            self.sent = end
        return b"".join(lines)


def raw_values(recording: Recording, board: Board) -> list[int]:
    """The excitation in steps of the board's drive. Raises RecordingError for a signal that the drive cannot give."""
    drive = board.drive
    name = drive.name if drive.name in recording.signals else next(iter(recording.signals))
    signal = signal_of(recording, name)
    values = signal.values if signal.unit is None else convert(signal.values, signal.unit, drive.unit)
    if not np.all(np.isfinite(values)):
        raise RecordingError(
            f"Excitation {recording.name!r}: {name!r} has missing values; fill them with fill_gaps first."
        )
    steps = np.rint(np.asarray(values) / drive.scale)
    worst = int(np.argmax(np.abs(steps)))
    if abs(steps[worst]) > drive.limit:
        raise RecordingError(
            f"Excitation {recording.name!r}: {name!r} is {values[worst]:g} {drive.unit} at "
            f"{recording.t[worst]:g} s, but the board gives up to {drive.limit * drive.scale:g} "
            f"{drive.unit}; scale it with `plantfit excite ... --voltage`."
        )
    return [int(s) for s in steps]


def whole_ratio(longer: float, shorter: float, what: str) -> int:
    """longer/shorter as a whole number; raises RecordingError with `what` otherwise."""
    ratio = longer / shorter
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
        raise RecordingError(what)
    return round(ratio)


def timing(board: Board, excitation: Recording | None, rate: float | None) -> tuple[int, int]:
    """(ticks to a sample, samples to a value). Raises RecordingError where the rates do not fit together."""
    tick = 1 / board.tick_hz
    period = None if excitation is None else uniform_period(excitation, "playing it")
    sample = 1 / rate if rate is not None else tick
    divide = whole_ratio(
        sample,
        tick,
        f"{1 / sample:g} samples a second do not fit the board's "
        f"{board.tick_hz} Hz; choose {board.tick_hz} divided by a whole number.",
    )
    if period is None:
        return divide, 1
    hold = whole_ratio(
        period,
        divide * tick,
        f"The excitation's step of {period:g} s is no whole number of samples of {divide * tick:g} s; "
        "make it at another rate or choose --rate.",
    )
    return divide, hold
