"""A controller on this computer that drives a board over the serial line, a sample of it every so many samples of
the board."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plantfit.errors import BoardError
from plantfit.rig.board.playback import whole_ratio
from plantfit.rig.board.protocol import Board, Sample
from plantfit.units import convert

SHORTEST = 0.02  # s: what a line and this computer take from a sample to a command, with room


class Running(Protocol):
    """A controller under way."""

    def begin(self, measurement: float) -> None:
        """At rest at this measurement, the command 0."""
        ...

    def update(self, measurement: float, reference: float) -> float:
        """The command of this sample."""
        ...


@dataclass(frozen=True)
class Loop:
    """What closes the loop: `controller` every `period` s from `output` to `input`, in their units, within `lower`
    and `upper`; set points (n,) from `times` (n,) in s on, for `seconds`. `sentence` goes into the recording."""

    controller: Running
    period: float
    output: str
    output_unit: str | None
    input: str
    input_unit: str | None
    lower: float
    upper: float
    times: np.ndarray
    set_points: np.ndarray
    seconds: float
    sentence: str


class Pilot:
    """The loop on one board whose samples come every `divide` ticks. Raises BoardError where they do not fit."""

    def __init__(self, loop: Loop, board: Board, divide: int):
        self.loop, self.board = loop, board
        names = [c.name for c in board.channels]
        if loop.output not in names or loop.input != board.drive.name:
            raise BoardError(
                f"The controller measures {loop.output!r} and drives {loop.input!r}; board {board.name!r} measures "
                f"{', '.join(names)} and "
                f"drives {board.drive.name!r}: tune the loop of a study whose recording came from this board."
            )
        self._place = names.index(loop.output)
        most = board.drive.limit * board.drive.scale
        for end in (loop.lower, loop.upper):
            if abs(self._drive(end)) > abs(most) * (1 + 1e-9) + 0.5 * abs(board.drive.scale):
                raise BoardError(
                    f"The controller drives {loop.input} up to {self._drive(end):.4g} "
                    f"{board.drive.unit}, but the board gives up to {abs(most):.4g} "
                    f"{board.drive.unit}; tune it within the limits of the board (--lower, --upper)."
                )
        if loop.period < SHORTEST:
            raise BoardError(
                f"A loop every {loop.period:g} s over the serial line is faster than this computer answers "
                f"({SHORTEST:g} s); compile the C "
                "file of the controller into the board's firmware, or tune with a longer period."
            )
        sample = divide / board.tick_hz
        self.every = whole_ratio(
            loop.period,
            sample,
            f"The controller's period of {loop.period:g} s is no "
            f"whole number of samples of {sample:g} s; choose --rate.",
        )
        unit = board.channels[self._place].unit
        self.column = f"{loop.output}_set [{unit}]" if unit else f"{loop.output}_set"
        self.wanted: float | None = None  # set point in the unit of the channel
        self.commands = self.late = self.starts = 0
        self._due, self._begun = 0, False
        self._raw: int | None = None  # what the drive is to get next

    def begin(self, counter: int) -> None:
        """The board started, or started again, at `counter`, its drive at 0."""
        self._due, self._begun, self._raw = counter, False, None
        self.starts += 1

    def take(self, sample: Sample, t: float) -> None:
        """A sample at `t` (s); the controller's own are those that are due."""
        channel, loop = self.board.channels[self._place], self.loop
        reference = float(loop.set_points[max(0, int(np.searchsorted(loop.times, t + 1e-9, side="right")) - 1)])
        self.wanted = self._unit(reference, loop.output_unit, channel.unit)
        behind = (sample.counter - self._due) % 2**32
        if behind >= 2**31:
            return
        measured = self._unit(channel.scale * sample.raw[self._place] + channel.offset, channel.unit, loop.output_unit)
        if not self._begun:
            loop.controller.begin(measured)
            self._begun = True
        command = self._drive(loop.controller.update(measured, reference)) / self.board.drive.scale
        self._raw = int(np.clip(round(command), -self.board.drive.limit, self.board.drive.limit))
        self.commands += 1
        self.late += behind > 0
        self._due = (self._due + (behind // self.every + 1) * self.every) % 2**32

    def command(self) -> int | None:
        """What the drive is to get, once for each sample of the controller."""
        raw, self._raw = self._raw, None
        return raw

    @property
    def told(self) -> str:
        """For the recording's log."""
        again = f"; it began anew {self.starts - 1} times" if self.starts > 1 else ""
        return (
            f"The controller on this computer gave {self.commands} commands, {self.late} of them late because "
            f"samples were lost{again}."
        )

    def _drive(self, value: float) -> float:
        return self._unit(value, self.loop.input_unit, self.board.drive.unit)

    @staticmethod
    def _unit(value: float, own: str | None, wanted: str | None) -> float:
        return float(convert(value, own, wanted)) if own and wanted and own != wanted else float(value)
