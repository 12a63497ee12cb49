"""A process that helps with studies of a store, as `processes.helping` starts it:

    PLANTFIT_HELPER_STORE=ADDRESS python -m plantfit.study.running.helper_main MAKER SECONDS STUDY [STUDY ...]

It makes the problems anew, shares the tasks through the store, saves a checkpoint every SECONDS, and ends when
all are done, when its standard input closes (the parent asks it to stop, or has died), or on SIGTERM.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from plantfit import collector
from plantfit.errors import PlantfitError, StoreError
from plantfit.study.problem_recipe import STUDY_FILES, Recipe
from plantfit.study.running.helper_processes import ADDRESS
from plantfit.study.running.runner import attend, joined, latched
from plantfit.study.running.task_worker import TaskWorker
from plantfit.study.store.store import Store


def main(maker: str, seconds: str, *studies: str) -> int:
    """What a helper does; returns its exit code."""
    collector.seldom()
    stop = latched(_asked_to_stop().is_set)
    try:
        store = Store.open(os.environ[ADDRESS], create=False)
        attend([_entrance(store, int(study), maker, stop, float(seconds)) for study in studies], stop)
    except PlantfitError as error:
        sys.stderr.write(f"{error}\n")  # the parent shows it
        return error.exit_code
    return 0


def _entrance(
    store: Store, study_id: int, maker: str, stop: Callable[[], bool], seconds: float
) -> Callable[[], TaskWorker]:
    def enter() -> TaskWorker:
        study = store.study(study_id)
        if study.spec_text is None and maker == STUDY_FILES:
            raise StoreError(
                f"Study {study_id} was made from Python without a study file; give helpers the place of its maker."
            )
        objective, to_physical = Recipe(maker, study.spec_text or "", study.spec_path or "").make()
        return joined(store, study_id, objective, to_physical, None, stop, checkpoint_seconds=seconds)

    return enter


def _asked_to_stop() -> threading.Event:
    """Set when standard input closes or on SIGTERM."""
    asked = threading.Event()

    def listen() -> None:
        with suppress(OSError, ValueError):
            while os.read(sys.stdin.fileno(), 4096):
                pass
        asked.set()

    signal.signal(signal.SIGTERM, lambda number, frame: asked.set())
    threading.Thread(target=listen, daemon=True).start()
    return asked


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
