"""Real trouble with the disk in the middle of a study: one sentence, and what was finished is kept."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_study_runner import bits
from worked_study import PLAN, begun, objective, physical

from plantfit.study import Store, resume, run

HERE = Path(__file__).parent
ROOM = 16_000  # bytes that the database may grow: a few of the runs, with or without checkpoints beside them
LONG = dataclasses.replace(PLAN, runs=12)

SCRIPT = """
import resource, signal, sys
import worked_study
from plantfit.cli import main

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # files cannot grow, as on a full disk
main.app = lambda standalone_mode: worked_study.main(sys.argv[1], int(sys.argv[2]), "1")
main.run_cli()
"""

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs limits of POSIX, which this system lacks")


@pytest.mark.thorough
def test_a_disk_that_fills_up_costs_nothing_that_was_finished(tmp_path):
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store, LONG, delay=0.0)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(HERE), *filter(None, sys.path)]),
        "JAX_ENABLE_COMPILATION_CACHE": "0",
    }
    limit = Path(store.name).stat().st_size + ROOM
    words = [sys.executable, "-c", SCRIPT, store.name, str(study_id), str(limit)]
    child = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=200)
    assert child.returncode == 10, child.stderr
    assert "Traceback" not in child.stderr
    assert child.stderr.strip().count("\n") == 0
    assert "study.db" in child.stderr
    kept = store.runs(study_id)
    assert 0 < len(kept) < LONG.runs * len(LONG.methods)
    resume(store, study_id, objective(0.0), to_physical=physical)  # there is room again
    whole = Store.open(tmp_path / "whole.db")
    assert bits(store.runs(study_id)) == bits(whole.runs(run(LONG, objective(0.0), whole, to_physical=physical)))
    assert [r.seconds for r in store.runs(study_id) if (r.method, r.run) in {(k.method, k.run) for k in kept}] == [
        r.seconds for r in kept
    ]
