"""A thread that says every few seconds that the holder of a task lives, even during long compilations."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from plantfit.errors import StoreError
from plantfit.study.claims import Claim, ClaimLost
from plantfit.study.store import Store

BEAT_SECONDS = 10.0


@contextmanager
def beating(store: Store, claim: Claim, seconds: float = BEAT_SECONDS) -> Iterator[threading.Event]:
    """Beat while the block runs; the event given is set once another worker has taken the task."""
    ended, lost = threading.Event(), threading.Event()

    def beat() -> None:
        while not ended.wait(seconds):
            try:
                # a database in trouble is reported by the next save, in the main thread
                with suppress(StoreError):
                    store.beat(claim)
            except ClaimLost:
                lost.set()
                return

    thread = threading.Thread(target=beat, name=f"plantfit heartbeat of task {claim.id}", daemon=True)
    thread.start()
    try:
        yield lost
    finally:
        ended.set()
        thread.join()
