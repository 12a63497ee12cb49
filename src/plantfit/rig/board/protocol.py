"""The line protocol of docs/recording-protocol.md: lines with checksums, a board's hello, its samples."""

import zlib
from dataclasses import dataclass
from typing import NamedTuple

from plantfit.errors import BoardError

VERSION = 1
RESTING, PLAYING, FINISHED, WATCHDOG, STARVED = range(5)
_LONGEST = 400  # bytes without a line feed that are kept
_MOST_CHANNELS = 256
_CHECK = 9  # '*' and eight hex digits


def encode(*fields: object) -> bytes:
    """One line: fields with commas, `*`, CRC-32 in hex, line feed."""
    text = ",".join(str(field) for field in fields).encode("ascii")
    return b"%s*%08X\n" % (text, zlib.crc32(text))


def decode(line: bytes) -> list[str] | None:
    """Fields of a line without its line feed; None where the checksum is wrong."""
    text, mark, told = line[:-_CHECK], line[-_CHECK : 1 - _CHECK], line[1 - _CHECK :]
    if mark != b"*" or told != b"%08X" % zlib.crc32(text):
        return None
    return text.decode("ascii", "replace").split(",")


class Lines:
    """Bytes to lines; counts what came and what was garbled."""

    def __init__(self) -> None:
        self.rest, self.received, self.good, self.garbled = b"", 0, 0, 0

    def feed(self, data: bytes) -> list[list[str]]:
        """The fields of the lines that `data` completes."""
        self.received += len(data)
        *whole, rest = (self.rest + data).split(b"\n")
        self.rest = rest if len(rest) <= _LONGEST else b"?" * _LONGEST
        found = []
        for line in whole:
            fields = decode(line) if line else None
            if fields is not None:
                found.append(fields)
            elif line:
                self.garbled += 1
        self.good += len(found)
        return found

    def broken_off(self) -> None:
        """The line went dead: an unfinished line will not be finished."""
        self.garbled += bool(self.rest)
        self.rest = b""


@dataclass(frozen=True)
class Channel:
    """A measured quantity: value = scale * raw + offset in `unit`."""

    name: str
    unit: str
    scale: float
    offset: float = 0.0


@dataclass(frozen=True)
class Drive:
    """What the board applies to the motor: value = scale * raw in `unit`, |raw| <= limit."""

    name: str
    unit: str
    scale: float
    limit: int


@dataclass(frozen=True)
class Board:
    """A board as its hello declares it. `watchdog` in s; `buffer`: values it holds ahead; `boot` differs after a
    reset."""

    name: str
    firmware: str
    boot: int
    tick_hz: int
    watchdog: float
    buffer: int
    drive: Drive
    channels: tuple[Channel, ...]

    def same_kind(self, other: "Board") -> bool:
        """Whether a recording can go on with `other`."""
        return (self.name, self.tick_hz, self.drive, self.channels) == (
            other.name,
            other.tick_hz,
            other.drive,
            other.channels,
        )


class Sample(NamedTuple):
    """One sample as the board sent it: `us` since its start modulo 2^32, `index` of the value applied or -1."""

    counter: int
    us: int
    drive: int
    index: int
    state: int
    raw: tuple[int, ...]

    @classmethod
    def read(cls, fields: list[str]) -> "Sample":
        counter, us, drive, index, state, *raw = map(int, fields[1:])
        return cls(counter, us, drive, index, state, tuple(raw))


class Hello:
    """Collects the lines of a hello, in any order and repeated."""

    def __init__(self) -> None:
        self._head: list[str] | None = None
        self._drive: Drive | None = None
        self._channels: dict[int, Channel] = {}

    def take(self, fields: list[str], port: str) -> None:
        """One line that begins with H, A or C. Raises BoardError for another version and for a hello that makes no
        sense."""
        if fields[0] == "H" and fields[1:2] != [str(VERSION)]:
            raise BoardError(
                f"The board on {port} speaks version {','.join(fields[1:2])} of the protocol and plantfit {VERSION}; "
                "flash the firmware that comes with this plantfit, or use the plantfit of that firmware."
            )
        try:
            if fields[0] == "H":
                numbers = [int(f) for f in fields[4:9]]
                if not all(abs(n) < 2**63 for n in numbers) or numbers[-1:] > [_MOST_CHANNELS]:
                    raise ValueError
                *_, channels = numbers
                self._head = fields if len(fields) == 9 and channels >= 0 else None
            elif fields[0] == "A":
                self._drive = Drive(fields[1], fields[2], float(fields[3]), int(fields[4]))
            else:
                self._channels[int(fields[1])] = Channel(fields[2], fields[3], float(fields[4]), float(fields[5]))
        except (ValueError, IndexError):
            raise BoardError(
                f"The board on {port} declares itself by {','.join(fields)!r}, which the protocol does not know."
            ) from None

    def board(self) -> Board | None:
        """The board once every line has come."""
        if self._head is None or self._drive is None:
            return None
        boot, tick_hz, watchdog_ms, buffer, count = map(int, self._head[4:9])
        if set(self._channels) != set(range(count)):
            return None
        channels = tuple(self._channels[k] for k in range(count))
        return Board(self._head[2], self._head[3], boot, tick_hz, watchdog_ms / 1000, buffer, self._drive, channels)
