"""Studies on a dask cluster: the same bits, nothing lost with a worker or the driver, one sentence each."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_study_runner import bits
from test_workers import until
from worked_study import MAKER, alone, begun, objective, physical, sums

from plantfit.errors import MissingExtra, SearchError, StoreError
from plantfit.study import Plan, Store, begin, resume, run
from plantfit.study.problem_recipe import Recipe
from plantfit.study.running.worker_names import where

distributed = pytest.importorskip("distributed", reason="needs dask[distributed], which is not installed")

from plantfit.study.cluster.driver import Job, connected, work_on_cluster

TEXT = "0.02"


@pytest.fixture(scope="module")
def client():
    with connected("local", 2) as client:
        yield client


def job(study_id, text=TEXT, maker=MAKER, files=None):
    return Job(study_id, Recipe(maker, text, "", files or {}))


@pytest.mark.thorough
def test_two_workers_of_a_cluster_change_no_bit(tmp_path, client):
    store, seen, said = Store.open(tmp_path / "study.db"), [], []
    study_id = begun(store)
    work_on_cluster(store, [job(study_id)], client, progress=seen.append, say=said.append)
    assert bits(store.runs(study_id)) == bits(alone())
    study = store.study(study_id)
    assert (study.state, study.notes, said) == ("done", (), [])
    places = {where(h.worker) for p in seen for h in p.workers}
    assert places == set(client.nthreads())  # both worked, and the progress says where
    assert [p.runs_done for p in seen] == sorted(p.runs_done for p in seen)


@pytest.mark.thorough
def test_a_lost_worker_costs_no_more_than_its_last_checkpoint(tmp_path, client):
    store, said = Store.open(tmp_path / "study.db"), []
    study_id = begun(store, delay=0.05)
    pids = client.run(os.getpid)
    saved = []

    def kill_once(p):
        """Once a task in the middle has a checkpoint, end the worker that has it."""
        whole = store.whole(study_id)
        middle = [t for t in whole.tasks if t.checkpoint is not None]
        at_work = {(h.task.method, h.task.first): where(h.worker) for h in store.held(study_id)}
        for t in middle:
            if not saved and at_work.get((t.method, t.first)) in pids:
                saved.append(t)
                os.kill(pids[at_work[t.method, t.first]], signal.SIGKILL)

    work_on_cluster(store, [job(study_id, "0.05")], client, progress=kill_once, say=said.append, checkpoint_seconds=0.1)
    assert len(saved) == 1
    assert [s for s in said if "was lost; another goes on with its task" in s]
    assert bits(store.runs(study_id)) == bits(alone())


@pytest.mark.thorough
def test_a_stopped_study_is_saved_and_goes_on_anywhere(tmp_path, client):
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store)
    work_on_cluster(store, [job(study_id)], client, stop=lambda: store.counts(study_id)[2] >= 3, checkpoint_seconds=0.1)
    assert store.held(study_id) == []
    assert store.study(study_id).state == "interrupted"
    assert 3 <= store.study(study_id).runs_done < 12
    resume(store, study_id, objective(0.0), to_physical=physical)
    assert bits(store.runs(study_id)) == bits(alone())


@pytest.mark.thorough
def test_recordings_travel_and_no_disk_is_shared(tmp_path, client):
    store = Store.open(tmp_path / "study.db")
    plan = Plan(name="sums", methods=("random",), runs=2, budget=60, seed=1, chunk=1)
    text, files = "numbers.txt", {"numbers.txt": b"0.25 0.5"}
    (tmp_path / "numbers.txt").write_bytes(files["numbers.txt"])
    mine, to_physical = sums(text, "", {"numbers.txt": tmp_path / "numbers.txt"}, None)
    study_id = begin(plan, mine, store, spec_text=text, to_physical=to_physical)
    work_on_cluster(store, [job(study_id, text, "worked_study:sums", files)], client)
    assert bits(store.runs(study_id)) == bits(store.runs(run(plan, mine, store, to_physical=to_physical)))


def test_what_goes_wrong_on_a_worker_is_one_sentence_here(tmp_path, client):
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store)
    with pytest.raises(StoreError, match="'worked_study:nothing' cannot be imported"):
        work_on_cluster(store, [job(study_id, maker="worked_study:nothing")], client)
    with pytest.raises(
        SearchError, match=r"failed at (lbfgsb|pso) from run \d on \(ZeroDivisionError: .*\); its log says more"
    ):
        work_on_cluster(store, [job(study_id, maker="worked_study:broken")], client)
    with pytest.raises(StoreError, match="began with another problem"):
        work_on_cluster(store, [job(study_id, "0.02", "worked_study:another")], client)
    assert store.held(study_id) == []
    assert store.study(study_id).state == "interrupted"


def test_other_software_there_is_noted(tmp_path, client, monkeypatch):
    monkeypatch.setattr("plantfit.study.store.store.cpu_model", lambda: "Another CPU")
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store, Plan(name="p", methods=("random",), runs=1, budget=20, seed=1), 0.0)
    work_on_cluster(store, [job(study_id, "0.0")], client)
    (note,) = store.study(study_id).notes
    assert "CPU Another CPU became" in note
    assert "may differ in their last bits" in note


def test_an_address_that_is_none_and_dask_missing(monkeypatch):
    """A scheduler that is not there: tests/cli/test_cli_workers.py."""
    with pytest.raises(SearchError, match="No dask scheduler answers at 'nonsense'") as caught, connected("nonsense"):
        pass
    assert "\n" not in str(caught.value)
    monkeypatch.setattr("plantfit.study.cluster.driver.find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"pip install 'plantfit\[cluster\]'"), connected("local"):
        pass


@pytest.mark.slow
def test_a_local_worker_that_dask_has_given_up_comes_back(tmp_path):
    """It was the last one, and the study waited for ever."""
    store, gone, limit = Store.open(tmp_path / "study.db"), [], time.monotonic() + 120.0
    study_id = begun(store, Plan(name="p", methods=("random",), runs=2, budget=20, seed=1, chunk=1), 0.0)

    def close_once(p):
        if not gone and store.held(study_id):
            gone.extend(client.run(os.getpid).values())
            client.sync(client.cluster.workers[0].close)

    with connected("local", 1) as client:
        work_on_cluster(
            store, [job(study_id, "0.3")], client, progress=close_once, stop=lambda: time.monotonic() > limit
        )
        assert {*gone}.isdisjoint(client.run(os.getpid).values())
    assert store.study(study_id).state == "done"


@pytest.mark.slow
def test_a_task_that_ends_every_worker_does_not_go_round_for_ever(tmp_path):
    store, said = Store.open(tmp_path / "study.db"), []
    study_id = begun(store, Plan(name="p", methods=("random",), runs=1, budget=20, seed=1), 0.0)
    with (
        connected("local", 1) as client,
        pytest.raises(SearchError, match="5 workers in a row were lost at random from run 0 on"),
    ):
        work_on_cluster(store, [job(study_id, maker="worked_study:deadly")], client, say=said.append)
    assert len([s for s in said if "was lost; another goes on" in s]) == 4
    assert store.held(study_id) == []


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler with one worker, as two processes; gives address and processes."""
    file = tmp_path / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment, "cwd": tmp_path}
    dask = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--port",
        "0",
        "--no-dashboard",
        "--host",
        "127.0.0.1",
    ]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    team = [subprocess.Popen([*dask, "--scheduler-file", str(file)], **quiet)]
    try:
        until(file.exists, "the scheduler did not begin")
        team.append(subprocess.Popen([*worker, "--scheduler-file", str(file)], **quiet))
        yield file, team
    finally:
        for process in reversed(team):
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_scheduler_at_an_address_and_its_end(tmp_path, scheduler):
    """The driver is killed, the next one goes on; then the scheduler is killed, which is one sentence; then this
    process ends it."""
    file, team = scheduler
    address = json.loads(file.read_text())["address"]
    store = Store.open(tmp_path / "study.db")
    study_id = begun(store)
    script = Path(__file__).with_name("worked_study.py")
    driver = subprocess.Popen([sys.executable, str(script), store.name, str(study_id), address])
    try:
        until(lambda: store.counts(study_id)[2] >= 1 and store.held(study_id), "the driver did not begin")
    finally:
        driver.kill()
        driver.wait()
    assert store.study(study_id).state == "interrupted"
    before = store.counts(study_id)[2]
    assert before < 12

    def end_scheduler(p):
        if p.runs_done > before + 1:
            team[0].kill()

    with (
        pytest.raises(SearchError, match="connection to the dask scheduler was lost") as caught,
        connected(address) as client,
    ):
        work_on_cluster(store, [job(study_id)], client, progress=end_scheduler)
    assert "\n" not in str(caught.value)
    assert store.held(study_id) == []
    assert before < store.counts(study_id)[2] < 12
    resume(store, study_id, objective(0.0), to_physical=physical)
    assert bits(store.runs(study_id)) == bits(alone())


def test_a_local_cluster_listens_to_this_machine_only(client):
    import psutil

    me = psutil.Process()
    mine = [
        c
        for p in (me, *me.children(recursive=True))
        for c in p.net_connections("inet")
        if c.status == psutil.CONN_LISTEN
    ]
    assert len(mine) >= 3  # a scheduler and two workers
    assert {c.laddr.ip for c in mine} <= {"127.0.0.1", "::1"}
