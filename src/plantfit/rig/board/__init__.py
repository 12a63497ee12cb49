"""Boards on a serial line: the protocol, the recorder, and what it plays."""

from plantfit.rig.board.protocol import Board, Channel, Drive, Sample
from plantfit.rig.board.recorded import Progress, Recorded
from plantfit.rig.board.recorder import record

__all__ = ["Board", "Channel", "Drive", "Progress", "Recorded", "Sample", "record"]
