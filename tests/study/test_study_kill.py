"""kill -9 in the middle, three times, then resume: the same bits as one sitting."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from killed_child import PLAN
from sqlalchemy import func, select
from test_study_runner import bits
from worked_study import objective

from plantfit.study import Store, resume, run
from plantfit.study.store import tables

CHILD = Path(__file__).with_name("killed_child.py")
PATIENCE = 120.0


def mark(store):
    """Tasks done and the newest checkpoint: something that grows with the work."""
    with store.engine.connect() as connection:
        task = tables.task.c
        done = connection.scalar(select(func.count()).where(task.state == "done"))
        blobs = connection.execute(
            select(task.id, task.checkpoint).where(task.state == "open", task.checkpoint.is_not(None))
        ).all()
    return done, [tuple(b) for b in blobs]


def kill_after_new_checkpoint(store):
    """Start the child, wait until it has saved something new in the middle of a task, kill it."""
    before = mark(store)
    said = Path(store.name).with_suffix(".stderr")  # a pipe that nobody reads would stop the child once it is full
    with said.open("w") as stderr:
        child = subprocess.Popen([sys.executable, str(CHILD), store.name], stderr=stderr)
    try:
        limit = time.monotonic() + PATIENCE
        while mark(store) == before or not mark(store)[1]:
            if child.poll() is not None:
                pytest.fail(f"the child ended by itself: {said.read_text()}")
            assert time.monotonic() < limit, f"the child saved no checkpoint: {said.read_text()}"
            time.sleep(0.01)
    finally:
        child.kill()
        child.wait()
    return child.returncode


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL, which this system lacks")
@pytest.mark.thorough
def test_three_kills_change_no_bit(tmp_path):
    store = Store.open(tmp_path / "killed.db")
    marks = []
    for _ in range(3):
        assert kill_after_new_checkpoint(store) == -signal.SIGKILL
        marks.append(mark(store))
        assert store.study(1).state == "interrupted"
    assert marks[0] != marks[1] != marks[2]
    assert store.study(1).runs_done < PLAN.runs * len(PLAN.methods)
    resume(store, 1, objective(0.0))  # at once: a claim of a dead process does not wait for its minute
    assert store.study(1).state == "done"
    once = Store.open(tmp_path / "once.db")
    run(PLAN, objective(0.0), once)
    assert bits(store.runs(1)) == bits(once.runs(1))
    assert len(store.runs(1)) == 6
