"""Checkpoints of one task: the newest is always at hand, one every few seconds goes to the store."""

import time
from collections.abc import Callable

from plantfit.study.claims import Claim
from plantfit.study.store import Store


class Keeper:
    """Takes checkpoints as often as a search offers them and saves one per `seconds`."""

    def __init__(self, store: Store, claim: Claim, seconds: float):
        self.store, self.claim, self.seconds = store, claim, seconds
        self._saved_at = time.monotonic()
        self._newest: Callable[[], bytes] | None = None

    def offer(self, encode: Callable[[], bytes]) -> None:
        """Remember the checkpoint and save it if the last save is long enough ago."""
        self._newest = encode
        if time.monotonic() - self._saved_at >= self.seconds:
            self.store.save_checkpoint(self.claim, encode())
            self._saved_at, self._newest = time.monotonic(), None

    def newest(self) -> bytes | None:
        """The newest checkpoint if it is not saved yet."""
        return None if self._newest is None else self._newest()
