"""Several processes on one machine: same bits for any number of workers and any order, nothing lost, one sentence
each."""

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from test_study_runner import bits
from worked_study import CHECKPOINT_SECONDS, MAKER, PLAN, alone, begun, objective, physical

from plantfit.study import Plan, Store, helping, resume, run, tasks
from plantfit.study.running.cores import free_memory, physical_cores, quota, sensible_workers
from plantfit.study.running.search import search_task
from plantfit.study.running.worker_names import new_worker, where

PATIENCE = 120.0


def until(condition, what):
    limit = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < limit, what
        time.sleep(0.02)


def pids(store, study_id):
    return {int(h.worker.split("|")[1]) for h in store.held(study_id)}


@pytest.mark.parametrize("workers", [2, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_more_workers_change_no_bit(tmp_path, workers):
    store, said, seen = Store.open(tmp_path / "study.db"), [], set()
    study_id = begun(store, delay=0.01)
    with helping(store, [study_id], workers - 1, maker=MAKER, say=said.append) as team:
        assert len(team) == workers - 1
        until(lambda: pids(store, study_id), "no helper came to work")
        resume(
            store,
            study_id,
            objective(0.01),
            to_physical=physical,
            progress=lambda p: seen.update(h.worker for h in p.workers),
        )
    assert [h.returncode for h in team] == [0] * len(team)
    assert said == []
    assert {int(w.split("|")[1]) for w in seen} > {os.getpid()}  # the line of workers showed this process and others
    assert bits(store.runs(study_id)) == bits(alone())
    assert store.study(study_id).notes == ()


def test_any_order_of_tasks_gives_the_same_bits():
    order = list(tasks(PLAN))
    random.Random(5).shuffle(order)
    found = []
    for task in order:
        found += search_task(
            objective(0.0), PLAN, task, progress=lambda p: None, checkpoint=lambda c: None, resume=None,
            stop=lambda: False
        )  # fmt: skip
    place = {(r.method, r.run): r for r in found}
    assert len(place) == len(found) == len(alone())
    for r in alone():
        other = place[r.method, r.run]
        assert (r.cost, r.evaluations, r.x.tobytes()) == (other.cost, other.evaluations, other.x.tobytes())
        assert r.history_cost.tobytes() == other.history_cost.tobytes()


def test_charges_are_those_that_the_study_began_with(store):
    plan = Plan(name="p", methods=("lbfgsb",), runs=2, budget=300, seed=3, chunk=1)
    seen = []
    study_id = run(plan, objective(0.0), store, progress=seen.append, stop=lambda: any(p.runs_done for p in seen))
    assert 0 < store.study(study_id).runs_done < 2
    assert store.plan(study_id).gradient_charge == 3.0
    resume(store, study_id, replace(objective(0.0), gradient_charge=7.0))
    again = run(plan, objective(0.0), store)
    assert bits(store.runs(study_id)) == bits(store.runs(again))


@pytest.mark.thorough
def test_leaving_the_block_stops_helpers_which_save_and_let_go(tmp_path):
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store)
    with helping(store, [study_id], 1, maker=MAKER) as team:
        until(lambda: pids(store, study_id) == {team[0].pid}, "the helper did not come to work")
    assert team[0].returncode == 0
    assert store.held(study_id) == []
    assert store.study(study_id).state == "interrupted"
    resume(store, study_id, objective(0.0), to_physical=physical)
    assert bits(store.runs(study_id)) == bits(alone())


def test_a_helper_that_cannot_work_says_why_in_one_sentence(tmp_path):
    store, said = Store.open(tmp_path / "study.db"), []
    study_id = begun(store)
    with helping(store, [study_id], 1, maker="worked_study:nothing", say=said.append):
        until(lambda: said, "nothing was said")
    (sentence,) = said
    assert sentence.startswith(
        "Worker 2 stopped: The problem of the study cannot be made here because 'worked_study:nothing'"
    )


def test_no_more_helpers_than_tasks(tmp_path):
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store, Plan(name="one", methods=("random",), runs=3, budget=50, seed=1))
    with helping(store, [study_id], 7, maker=MAKER) as team:
        assert team == []


class Killer:
    """Starts worked_study.py with helpers as often as needed, and kills whoever holds a task, or the parent."""

    def __init__(self, store, study_id, workers, seed):
        self.store, self.study_id, self.workers = store, study_id, workers
        self.random = random.Random(seed)
        self.parent: subprocess.Popen[bytes] | None = None
        self.kills, self.kinds = 0, set()
        self.left = 0  # helpers of this parent that were not killed; it starts no others
        # a pipe that nobody reads would stop the parent once it is full
        self.said = Path(store.name).with_suffix(".stderr")

    def mark(self):
        whole = self.store.whole(self.study_id)
        return whole.study.runs_done, [t.checkpoint for t in whole.tasks]

    def wanted(self):
        """The first two kills take one of each, so that no luck of the machine leaves a kind out."""
        if self.kills < 2:
            return ("helper", "parent")[self.kills]
        return "helper" if self.left and self.random.random() < 0.6 else "parent"

    def helpers(self):
        parent = self.parent.pid if self.parent else None
        return sorted(pids(self.store, self.study_id) - {parent})

    def kill_one(self):
        """Wait for something new in the store, then kill -9; False once the study is done."""
        if self.parent is None or self.parent.poll() is not None:
            words = [sys.executable, os.path.join(os.path.dirname(__file__), "worked_study.py"), self.store.name]
            with self.said.open("w") as stderr:
                self.parent = subprocess.Popen([*words, str(self.study_id), str(self.workers)], stderr=stderr)
            self.left = self.workers - 1
        before, kind = self.mark(), self.wanted()
        limit = time.monotonic() + PATIENCE
        while self.mark() == before or not (self.helpers() if kind == "helper" else pids(self.store, self.study_id)):
            if self.store.study(self.study_id).state == "done":
                return False
            if self.parent.poll() is not None:
                pytest.fail(f"the parent ended by itself: {self.said.read_text()}")
            assert time.monotonic() < limit, f"nothing new came into the store: {self.said.read_text()}"
            time.sleep(0.02)
        time.sleep(self.random.random() * 0.1)
        helpers = self.helpers()
        if kind == "helper" and helpers:
            os.kill(self.random.choice(helpers), signal.SIGKILL)
            self.left -= 1
        elif kind == "parent":
            self.parent.kill()
            self.parent.wait()
            until(lambda: not any(map(alive, helpers)), "helpers outlived their parent")
        else:
            return True  # the helper let go while we slept: try again
        self.kinds.add(kind)
        self.kills += 1
        return True

    def end(self):
        if self.parent is not None and self.parent.poll() is None:
            self.parent.kill()
            self.parent.wait()


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def killed(store, plan, kills, workers, seed, delay=0.02):
    """The runs of a study in which so many processes were killed at random moments."""
    study_id = begun(store, plan, delay)
    killer = Killer(store, study_id, workers, seed)
    try:
        while killer.kills < kills:
            assert killer.kill_one(), f"the study was done after {killer.kills} kills; give it more work"
    finally:
        killer.end()
    assert store.study(study_id).runs_done < plan.runs * len(plan.methods)
    resume(store, study_id, objective(0.0), to_physical=physical, checkpoint_seconds=CHECKPOINT_SECONDS)
    assert store.study(study_id).state == "done"
    return store.runs(study_id), killer.kinds


needs_proc = pytest.mark.skipif(
    not os.path.isdir("/proc/self"), reason="needs /proc and SIGKILL, which this system lacks"
)


@needs_proc
@pytest.mark.thorough
def test_three_kills_of_helpers_and_parents_change_no_bit(tmp_path):
    # so slow that no luck of the machine ends the study before the third kill; what is left is done at full speed
    runs, kinds = killed(Store.open(tmp_path / "study.db"), PLAN, 3, 2, seed=2, delay=0.3)
    assert kinds == {"helper", "parent"}
    assert bits(runs) == bits(alone())


@needs_proc
@pytest.mark.slow
def test_a_hundred_kills_of_helpers_and_parents_change_no_bit(tmp_path):
    plan = replace(PLAN, runs=80, budget=900)
    runs, kinds = killed(Store.open(tmp_path / "study.db"), plan, 100, 3, seed=3, delay=0.03)
    once = Store.open(tmp_path / "once.db")
    assert kinds == {"helper", "parent"}
    assert bits(runs) == bits(once.runs(run(plan, objective(0.0), once, to_physical=physical)))


def test_names_of_workers_are_readable():
    assert where(new_worker()).startswith(f"process {os.getpid()} on ")
    assert where(new_worker("tcp://10.0.0.5:4444")) == "tcp://10.0.0.5:4444"


def test_cores_are_counted_without_hyperthreads_quota_and_memory(tmp_path):
    own = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    for cpu in own:
        place = tmp_path / f"cpu{cpu}" / "topology"
        place.mkdir(parents=True)
        (place / "thread_siblings_list").write_text("0-1\n")
    assert physical_cores(tmp_path) == 1
    assert physical_cores(tmp_path / "missing") == len(own)
    (tmp_path / "cpu.max").write_text("150000 100000\n")
    assert quota(tmp_path) == 1.5
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert quota(tmp_path) == quota(tmp_path / "missing") == float("inf")
    (tmp_path / "meminfo").write_text("MemTotal: 100 kB\nMemAvailable:   2048 kB\n")
    assert free_memory(tmp_path / "meminfo") == 2048 * 1024
    assert free_memory(tmp_path / "missing") == float("inf")
    assert 1 <= sensible_workers() <= physical_cores()
