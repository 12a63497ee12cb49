"""Worker processes on this machine that help with studies of one store; see helper.py for what they do."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress

from plantfit.study.problem_recipe import STUDY_FILES
from plantfit.study.running.runner import CHECKPOINT_SECONDS
from plantfit.study.store.store import Store

ADDRESS = "PLANTFIT_HELPER_STORE"  # not in the command line: a URL may hold a password, and every user sees those

PATIENCE = 60.0  # seconds to wait for a checkpoint of a helper that was asked to stop


@contextmanager
def helping(
    store: Store,
    studies: Sequence[int],
    count: int,
    *,
    maker: str = STUDY_FILES,
    say: Callable[[str], None] = lambda sentence: None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> Generator[list[subprocess.Popen]]:
    """Have `count` processes work on studies of a store while the block runs; at its end they save and stop.

    `maker` is the place of a `recipe.Maker`. `say` gets a sentence, from another thread, when a helper ends before its
    time; the others go on with its task. No more are started than there are open tasks beside the one of this process.
    """
    address = store.address
    team: list[subprocess.Popen] = []
    watchers: list[threading.Thread] = []
    try:
        for number in range(min(count, _open_tasks(store, studies) - 1)):
            team.append(_start(maker, address, studies, checkpoint_seconds))
            watchers.append(threading.Thread(target=_watch, args=(team[-1], number + 2, say), daemon=True))
            watchers[-1].start()
        yield team
    except KeyboardInterrupt:
        for helper in team:
            helper.kill()  # their claims are free at once, their newest checkpoints are saved
        raise
    finally:
        for helper in team:
            with suppress(OSError):
                helper.stdin.close()  # pyrefly: ignore[missing-attribute]
        _wait(team)
        for watcher in watchers:
            watcher.join(1.0)


def _open_tasks(store: Store, studies: Sequence[int]) -> int:
    counts = [store.counts(study) for study in studies]
    return sum(total - done for done, total, *_ in counts)


def _start(maker: str, address: str, studies: Sequence[int], checkpoint_seconds: float) -> subprocess.Popen:
    # what this process can import, its helpers can; -c and notebooks have no module to start anew
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path), ADDRESS: address}
    return subprocess.Popen(
        [sys.executable, "-m", "plantfit.study.running.helper_main", maker, str(checkpoint_seconds),
         *map(str, studies)],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment, text=True,
        start_new_session=True,  # Ctrl-C in the terminal is for the parent, which passes it on
    )  # fmt: skip


def _watch(helper: subprocess.Popen, number: int, say: Callable[[str], None]) -> None:
    said = helper.stderr.read().strip()  # pyrefly: ignore[missing-attribute]
    code = helper.wait()
    if code < 0 and not helper.stdin.closed:  # pyrefly: ignore[missing-attribute]
        say(f"Worker {number} was ended by {signal.Signals(-code).name}; the others go on with its task.")
    elif code > 0:
        say(f"Worker {number} stopped: {said.splitlines()[-1] if said else f'exit code {code}'}")


def _wait(team: Sequence[subprocess.Popen]) -> None:
    for helper in team:
        try:
            helper.wait(PATIENCE)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            helper.kill()
            helper.wait()
