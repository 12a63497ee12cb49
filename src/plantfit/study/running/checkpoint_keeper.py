"""Checkpoints of one task: the newest is always at hand, one every few seconds is saved."""

import time
from collections.abc import Callable


class Keeper:
    """Takes checkpoints as often as a search offers them and gives `save` one per `seconds`."""

    def __init__(self, save: Callable[[bytes], None], seconds: float):
        self.save, self.seconds = save, seconds
        self._saved_at = time.monotonic()
        self._newest: Callable[[], bytes] | None = None

    def offer(self, encode: Callable[[], bytes]) -> None:
        """Remember the checkpoint and save it if the last save is long enough ago."""
        self._newest = encode
        if time.monotonic() - self._saved_at >= self.seconds:
            self.save(encode())
            self._saved_at, self._newest = time.monotonic(), None

    def newest(self) -> bytes | None:
        """The newest checkpoint if it is not saved yet."""
        return None if self._newest is None else self._newest()
