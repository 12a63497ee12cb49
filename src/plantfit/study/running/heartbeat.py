"""A thread that says every few seconds that the holder of a task lives, even during long compilations."""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from plantfit.errors import StoreError
from plantfit.study.store.claims import Claim, ClaimLost
from plantfit.study.store.store import Store

BEAT_SECONDS = 3.0  # others show the progress of this worker no older than this


def _unknown() -> float | None:
    return None


@contextmanager
def beating(
    store: Store, claim: Claim, evaluations: Callable[[], float | None] = _unknown, seconds: float = BEAT_SECONDS
) -> Generator[threading.Event]:
    """Beat while the block runs, telling what `evaluations` says; the event given is set once another worker has
    taken the task."""
    ended, lost = threading.Event(), threading.Event()

    def beat() -> None:
        while not ended.wait(seconds):
            try:
                # a database in trouble is reported by the next save, in the main thread
                with suppress(StoreError):
                    store.beat(claim, evaluations())
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
