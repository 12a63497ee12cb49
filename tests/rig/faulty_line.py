"""A serial line with faults between a board and a recorder: flipped bits, lost bytes, stalls, and a plug that is
pulled."""

import contextlib
import os
import pty
import select
import threading
import time
import tty
from pathlib import Path

import numpy as np


class FaultyLine:
    """`port` is a link to a pseudo-terminal that passes bytes to and from `board`; `events` are (after s,
    "stall"|"unplug", for s).

    `flip` and `drop` are probabilities for every byte of either direction; time counts from the first byte of the
    recorder.
    """

    def __init__(self, board: str, port: Path, *, seed: int, flip: float = 0.0, drop: float = 0.0, events=()):
        self.port, self.flip, self.drop = port, flip, drop
        self.flipped = self.dropped = 0
        self._events = list(events)
        self._rng = np.random.default_rng(seed)
        self._board = os.open(board, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._board)
        self._plug()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self):
        self._ended.set()
        self._thread.join(10)
        self._unplug()
        os.close(self._board)

    def _plug(self):
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port.symlink_to(os.ttyname(self._slave))

    def _unplug(self):
        self.port.unlink(missing_ok=True)
        if self._master is not None and self._slave is not None:
            os.close(self._master)
            os.close(self._slave)
        self._master = self._slave = None

    def _run(self):
        began, until, kind = None, 0.0, None
        while not self._ended.is_set():
            now = time.monotonic()
            if kind is not None and now > until:
                if kind == "unplug":
                    self._plug()
                kind = None
            if kind is None and began is not None and self._events and now - began > self._events[0][0]:
                _, kind, seconds = self._events.pop(0)
                until = now + seconds
                if kind == "unplug":
                    self._unplug()
            if kind == "stall":
                time.sleep(0.002)
                continue
            ends = [self._board] if self._master is None else [self._board, self._master]
            for end in select.select(ends, [], [], 0.002)[0]:
                with contextlib.suppress(BlockingIOError):
                    data = os.read(end, 4096)
                    if end == self._master and began is None:
                        began = now
                    other = self._master if end == self._board else self._board
                    if other is not None:  # else the wire is cut
                        os.write(other, self._spoiled(data))

    def _spoiled(self, data: bytes) -> bytes:
        values = np.frombuffer(data, np.uint8).copy()
        hit = self._rng.random(len(values)) < self.flip
        values[hit] ^= (1 << self._rng.integers(0, 8, int(hit.sum()))).astype(np.uint8)
        kept = self._rng.random(len(values)) >= self.drop
        self.flipped += int(hit.sum())
        self.dropped += int((~kept).sum())
        return values[kept].tobytes()
