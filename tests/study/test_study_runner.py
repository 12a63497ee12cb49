import threading
import time

import numpy as np
import pytest
from sqlalchemy import update
from study_fakes import FakeSearch, fake_result, objective, to_physical

from plantfit.errors import SearchError, StoreError
from plantfit.optimize.contract import Objective
from plantfit.optimize.loop.progress import Progress
from plantfit.study import Plan, Store, resume, run
from plantfit.study.running.runner import begin
from plantfit.study.running.study_progress import Meter
from plantfit.study.running.worker_names import STALE_SECONDS
from plantfit.study.store import tables
from plantfit.study.store.codec import to_json
from plantfit.study.versions import SEARCHES

PLAN = Plan(name="gearmotor", methods=("random", "pso"), runs=5, budget=40, seed=4, chunk=2)
BACKENDS = ("sqlite", "postgresql")
ALL = [(method, k) for first in (0, 2, 4) for method in PLAN.methods for k in range(first, min(first + 2, 5))]
BY_METHOD = [(method, k) for method in PLAN.methods for k in range(PLAN.runs)]


def bits(runs):
    """Everything of runs that must not depend on how they came about (seconds do)."""
    vectors = ("x", "history_evaluations", "history_cost")
    scalars = ("method", "run", "seed", "cost", "parameters", "evaluations", "status", "failures")
    found = []
    for r in runs:
        extra = {key: value for key, value in r.extra.items() if key != "compile_seconds"}
        found.append(
            [extra, *(getattr(r, name) for name in scalars), *(getattr(r, name).tobytes() for name in vectors)]
        )
    return found


def expected():
    return [fake_result(PLAN, method, k) for method, k in BY_METHOD]


def test_run_does_every_task_once_and_keeps_physical_parameters(store):
    search, seen = FakeSearch(), []
    study_id = run(
        PLAN,
        objective(),
        store,
        spec_text="x",
        coordinates=("a", "b", "c"),
        to_physical=to_physical,
        progress=seen.append,
        search=search,
    )
    assert search.done == ALL
    runs = store.runs(study_id)
    assert [r.cost for r in runs] == [r.cost for r in expected()]
    assert list(runs[3].parameters.values()) == np.asarray(to_physical(runs[3].x)).tolist()
    assert list(runs[3].parameters) == ["a", "b", "c"]
    study = store.study(study_id)
    assert (study.state, study.runs_done, study.coordinates, study.notes) == ("done", 10, ("a", "b", "c"), ())


def test_progress_adds_up_over_tasks(store):
    seen = []
    run(PLAN, objective(), store, progress=seen.append, search=FakeSearch())
    done = [p.runs_done for p in seen]
    assert done == sorted(done)
    assert {p.method for p in seen} == set(PLAN.methods)
    assert all(p.runs == 10 and p.tasks == 6 and p.budget_total == 400.0 for p in seen)
    last = seen[-1]
    assert (last.runs_done, last.tasks_done, last.evaluations, last.seconds_left) == (10, 6, 400.0, 0.0)
    assert last.best == min(r.cost for r in expected())
    assert all(p.seconds_left is not None and p.seconds_left >= 0 for p in seen[3:])


def test_time_left_follows_the_pace_of_this_sitting_only(store, monkeypatch):
    now, seen = [0.0], []
    monkeypatch.setattr("plantfit.study.running.study_progress.time.monotonic", lambda: now[0])
    meter = Meter(store, store.add(PLAN, spec_text=None, coordinates=("a", "b", "c"), probe=b""), PLAN, seen.append)
    meter.refresh("random")
    for seconds, evaluations in ((5.0, 60.0), (6.0, 70.0), (7.0, 80.0)):  # 60 came from a checkpoint
        now[0] = seconds
        meter(Progress(0, 2, evaluations, 80.0, 1.0, seconds, None))
    assert [p.seconds_left for p in seen] == [None, None, 33.0, 32.0]


@pytest.mark.parametrize("after", [1, 2, 5, 9])
def test_stop_then_resume_equals_one_sitting(store, after):
    search = FakeSearch()
    study_id = run(PLAN, objective(), store, stop=lambda: len(search.done) >= after, search=search)
    study = store.study(study_id)
    assert study.state == "interrupted"
    assert study.runs_done < 10
    assert resume(store, study_id, objective(), search=search) == study_id
    assert search.done == ALL  # no run twice: the checkpoint of the stopped task was taken up
    assert [r.cost for r in store.runs(study_id)] == [r.cost for r in expected()]
    assert store.study(study_id).state == "done"
    resume(store, study_id, objective(), search=search)
    assert len(search.done) == 10


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_whatever_raises_the_work_is_kept(store, error):
    def explode(task, k):
        if (task.method, k) == ("random", 3):
            raise error

    search = FakeSearch()
    with pytest.raises(error):
        run(PLAN, objective(), store, search=FakeSearch(explode, search.done))
    assert store.study(1).state == "interrupted"
    resume(store, 1, objective(), search=search)
    assert search.done == ALL
    assert [r.cost for r in store.runs(1)] == [r.cost for r in expected()]


def test_a_failing_store_stops_the_study_with_its_own_sentence(store, monkeypatch):
    def full(self, claim, checkpoint):
        raise StoreError("full")

    with monkeypatch.context() as patched:
        patched.setattr(Store, "save_checkpoint", full)
        with pytest.raises(StoreError, match="full"):
            run(PLAN, objective(), store, search=FakeSearch(), checkpoint_seconds=0.0)
    resume(store, 1, objective(), search=FakeSearch())
    assert [r.cost for r in store.runs(1)] == [r.cost for r in expected()]


def test_checkpoints_are_saved_at_their_interval(store, monkeypatch):
    saved = []
    monkeypatch.setattr(Store, "save_checkpoint", lambda self, claim, blob: saved.append(blob))
    run(PLAN, objective(), store, search=FakeSearch(), checkpoint_seconds=0.0)
    assert len(saved) == 10
    run(PLAN, objective(), store, search=FakeSearch(), checkpoint_seconds=60.0)
    assert len(saved) == 10


def test_two_workers_share_the_tasks_and_do_none_twice(store):
    search = FakeSearch(lambda task, k: time.sleep(0.02))
    ready = threading.Event()

    def first():
        run(PLAN, objective(), store, progress=lambda p: ready.set(), search=search)

    thread = threading.Thread(target=first)
    thread.start()
    assert ready.wait(10)
    other = Store.open(store.name)
    resume(other, 1, objective(), search=search)
    assert other.study(1).runs_done == 10  # the second waits for what the first holds
    thread.join()
    assert sorted(search.done) == sorted(ALL)
    assert store.study(1).state == "done"


def test_a_worker_that_was_overtaken_leaves_the_task_to_the_other(store, monkeypatch):
    """The first worker sleeps through its claim; a second does the study; the first must add nothing."""
    plan = Plan(name="p", methods=("random",), runs=1, budget=40, seed=4)
    real = time.time

    def overtake(task, k):
        monkeypatch.setattr("plantfit.study.store.store.time.time", lambda: real() + STALE_SECONDS + 1)
        resume(store, 1, objective(), search=FakeSearch())

    run(plan, objective(), store, search=FakeSearch(overtake))
    assert [r.cost for r in store.runs(1)] == [fake_result(plan, "random", 0).cost]
    assert store.study(1).state == "done"


def test_another_problem_is_refused(store):
    study_id = run(PLAN, objective(), store, to_physical=to_physical, stop=lambda: True, search=FakeSearch())
    other = Objective(dimension=3, costs=lambda z: objective().costs(z) + 0.01)
    with pytest.raises(StoreError, match="began with another problem"):
        resume(store, study_id, other, to_physical=to_physical)
    with pytest.raises(StoreError, match="other bounds, scales or to_physical"):
        resume(store, study_id, objective())
    with pytest.raises(StoreError, match="number of free parameters"):
        resume(store, study_id, Objective(dimension=2, costs=lambda z: z[:, 0]))
    with pytest.raises(StoreError, match="no study 99"):
        resume(store, 99, objective())
    assert store.study(study_id).runs_done == 0


def test_other_versions_are_noted(store, monkeypatch):
    study_id = run(PLAN, objective(), store, stop=lambda: True, search=FakeSearch())
    monkeypatch.setattr("plantfit.study.running.runner.cpu_model", lambda: "Another CPU")
    resume(store, study_id, objective(), search=FakeSearch())
    (note,) = store.study(study_id).notes
    assert "became Another CPU" in note


@pytest.mark.parametrize("spoil", [lambda r: r[:-1], lambda r: r[::-1], lambda r: [*r, r[0]]])
def test_a_method_that_mixes_up_runs_is_refused(store, spoil):
    def broken(*args, **kwargs):
        return spoil(FakeSearch()(*args, **kwargs))

    with pytest.raises(SearchError, match="report this to its author"):
        run(PLAN, objective(), store, search=broken)
    assert store.runs(1) == []


def test_coordinates_must_fit_the_problem(store):
    with pytest.raises(SearchError, match="names 2 coordinates"):
        run(PLAN, objective(), store, coordinates=("a", "b"), search=FakeSearch())
    assert store.studies() == []


@pytest.mark.thorough
def test_real_methods_give_the_same_bits_in_any_chunks(store):
    methods, settings = ("random", "pso", "lbfgsb"), {"pso": {"population": 10}}
    plans = [
        Plan(name="p", methods=methods, runs=3, budget=400, seed=7, settings=settings, chunk=chunk)
        for chunk in (3, 2, 1)
    ]
    found = [store.runs(run(plan, objective(), store, to_physical=to_physical)) for plan in plans]
    assert bits(found[0]) == bits(found[1]) == bits(found[2])
    assert [r.cost for r in found[0] if r.method == "lbfgsb"] == pytest.approx([0.0] * 3, abs=1e-20)


@pytest.mark.parametrize("before", [None, "1", "9"], ids=["first edition", "named first edition", "later edition"])
def test_a_study_is_finished_only_by_the_searches_that_it_was_begun_with(store, before):
    """Its other runs took other steps: they could not be compared, and nobody would see why."""
    study_id = begin(PLAN, objective(), store)
    versions = dict(store.study(study_id).versions)
    assert versions.pop("searches") == str(SEARCHES)
    if before is not None:
        versions["searches"] = before
    with store.engine.begin() as connection:
        connection.execute(update(tables.study).where(tables.study.c.id == study_id).values(versions=to_json(versions)))
    with pytest.raises(
        StoreError,
        match=rf"begun by plantfit 0\.\S+ with edition {before or 1} of the searches.*has edition {SEARCHES}",
    ):
        resume(store, study_id, objective(), search=FakeSearch())
    assert store.study(study_id).runs_done == 0
