"""Where a recording stands, and what it came to."""

from dataclasses import dataclass
from pathlib import Path

from plantfit.rig.board.protocol import Board, Sample


@dataclass(frozen=True)
class Progress:
    """Where a recording stands. `latest` are samples since the last call, `connected` is False while the port is
    away."""

    board: Board
    seconds: float
    samples: int
    lost: int
    garbled: int
    reconnects: int
    connected: bool
    played: int
    values: int
    latest: tuple[Sample, ...]


@dataclass(frozen=True)
class Recorded:
    """What a recording came to.

    `samples` came, `lost` did not, in `gaps` stretches. `garbled` lines had a wrong checksum here,
    `refused` ones on the board. `dropped`: samples for which the board found no room on the line.
    `starved`: times the values to play came too late. `watchdogs`: times the board stopped the motor
    because this machine was silent. `stopped`: the board acknowledged the last stop. `played` of
    `values` were applied.
    """

    path: Path
    board: Board
    seconds: float
    samples: int
    lost: int
    gaps: int
    garbled: int
    refused: int
    dropped: int
    starved: int
    watchdogs: int
    reconnects: int
    resets: int
    stopped: bool
    played: int
    values: int
    log: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether the whole excitation was played."""
        return self.played == self.values
