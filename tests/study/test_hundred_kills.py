"""34 kill -9 of Dask workers at random moments: the same bits. With the 100 of parents and helpers in
test_workers.py."""

import os
import random
import signal
from dataclasses import replace

import pytest
from test_study_runner import bits
from test_workers import needs_proc
from worked_study import MAKER, PLAN, begun, objective, physical

from plantfit.study import Store, run
from plantfit.study.problem_recipe import Recipe
from plantfit.study.running.worker_names import where

pytest.importorskip("distributed", reason="needs dask[distributed], which is not installed")

from plantfit.study.cluster.driver import MOST_LOSSES, Job, connected, work_on_cluster

KILLS = 34


@needs_proc
@pytest.mark.slow
def test_kills_of_dask_workers_change_no_bit(tmp_path):
    plan, chance = replace(PLAN, runs=40, budget=900), random.Random(7)
    store, said, killed, at, before = Store.open(tmp_path / "study.db"), [], [], [], None
    study_id = begun(store, plan, delay=0.03)

    def kill(progress):
        """Once something new is in the store, and with luck, end one of the workers that hold a task."""
        nonlocal before
        whole = store.whole(study_id)
        mark = whole.study.runs_done, [t.checkpoint for t in whole.tasks]
        if len(killed) >= KILLS or mark == before or chance.random() < 0.3:
            return
        newest = {(t.method, t.first): (t.method, t.first, t.checkpoint) for t in whole.tasks}
        places = {where(h.worker): newest[h.task.method, h.task.first] for h in store.held(study_id)}
        # the fifth loss of a task without a new checkpoint ends the study, and slow starts make room for as many
        places = {place: state for place, state in places.items() if at.count(state) < MOST_LOSSES - 2}
        known = {
            address: info
            for address, info in client.scheduler_info(n_workers=-1)["workers"].items()
            if address in places
        }
        if not known:
            return
        before, place = mark, chance.choice(sorted(known))
        pids = client.run(os.getpid, workers=[place], on_error="ignore")
        for pid in pids.values():
            if isinstance(pid, int):
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                at.append(places[place])

    with connected("local", 2) as client:
        jobs = [Job(study_id, Recipe(MAKER, "0.03", "", {}))]
        work_on_cluster(store, jobs, client, progress=kill, say=said.append, checkpoint_seconds=0.1)
    assert len(killed) == KILLS, "the study was done before; give it more work"
    assert [s for s in said if "was lost; another goes on with its task" in s]
    assert store.study(study_id).state == "done"
    once = Store.open(tmp_path / "once.db")
    assert bits(store.runs(study_id)) == bits(once.runs(run(plan, objective(0.0), once, to_physical=physical)))
