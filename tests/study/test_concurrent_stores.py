"""Many processes on one store, for real: nothing is done twice, nothing is lost, readers see one moment."""

import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from many_workers import NAMES, plan

from plantfit.study import Store

BACKENDS = ("sqlite", "postgresql")
SCRIPT = Path(__file__).with_name("many_workers.py")
RUNS = 24
ALL = [(method, first) for method in ("random", "pso") for first in range(0, RUNS, 2)]

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, which this system lacks")


def start(address, processes, what, runs=RUNS):
    words = [sys.executable, str(SCRIPT), address, str(processes), str(runs), what]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def done_by(process):
    said, wrong = process.communicate(timeout=120)
    assert process.returncode == 0, wrong
    return [(int(study), method, int(first)) for study, method, first in (line.split() for line in said.splitlines())]


@pytest.mark.thorough
def test_eight_processes_do_no_task_twice_and_lose_none(store):
    store = Store.open(store.address, busy_timeout=30.0)
    study_id = store.add(plan("shared", RUNS), spec_text=None, coordinates=NAMES, probe=b"")
    process, seen = start(store.address, 8, "share"), []
    while process.poll() is None:  # readers while running
        whole = store.whole(study_id)
        assert len(whole.runs) == whole.study.runs_done == sum(t.count for t in whole.tasks if t.done)
        done, _, runs, evaluations, _ = store.counts(study_id)
        assert (runs, evaluations) == (2 * done, 40.0 * done)
        seen.append(done)
        time.sleep(0.01)  # a reader that never rests takes the processor from those that write
    assert seen == sorted(seen)
    assert Counter(done_by(process)) == Counter((study_id, *task) for task in ALL)
    assert store.study(study_id).state == "done"
    assert len(store.study(study_id).notes) == len(ALL)  # no note was lost to another writer
    assert [(r.method, r.run) for r in store.runs(study_id)] == [(m, k) for m in ("random", "pso") for k in range(RUNS)]


@pytest.mark.thorough
def test_ten_studies_write_at_once_to_a_store_that_they_all_make(store, tmp_path, request):
    """All ten find a database without tables; one makes them."""
    address = (
        str(tmp_path / "fresh.db") if "sqlite" in store.engine.dialect.name else request.getfixturevalue("postgres_url")
    )
    found = Counter(done_by(start(address, 10, "own", 4)))
    store = Store.open(address)
    studies = store.studies()
    assert len(studies) == 10
    assert set(found) == {(s.id, m, k) for s in studies for m in ("random", "pso") for k in (0, 2)}
    assert set(found.values()) == {1}
    assert {(s.state, s.runs_done, len(store.runs(s.id))) for s in studies} == {("done", 8, 8)}
