"""Clocks that jump and a server that is started anew in the middle of a study: the same bits, nothing lost."""

import random
import time

import postgres_server
import pytest
from study_fakes import FakeSearch, objective, to_physical
from test_study_runner import PLAN, bits
from test_study_store import add, claim_one, finish_one

from plantfit.errors import StoreError
from plantfit.study import Store, resume, run
from plantfit.study.running.worker_names import AHEAD_SECONDS, STALE_SECONDS, is_stale
from plantfit.study.store.claims import ClaimLost

DAY = 86_400.0


@pytest.fixture
def clock(monkeypatch):
    """Seconds by which the clock of the machine has been set."""
    real, moved = time.time, [0.0]
    monkeypatch.setattr("plantfit.study.store.store.time.time", lambda: real() + moved[0])
    return moved


def test_a_clock_that_jumps_about_changes_no_bit(tmp_path, clock):
    shaken = random.Random(1)

    def jump(task, k):
        clock[0] = shaken.choice([-DAY, -90.0, 0.0, 90.0, DAY])

    store, once = Store.open(tmp_path / "study.db"), Store.open(tmp_path / "once.db")
    study_id = run(PLAN, objective(), store, to_physical=to_physical, search=FakeSearch(jump))
    assert store.study(study_id).state == "done"
    clock[0] = 0.0
    again = run(PLAN, objective(), once, to_physical=to_physical, search=FakeSearch())
    assert bits(store.runs(study_id)) == bits(once.runs(again))


def test_a_jump_ahead_takes_a_task_from_a_live_worker_and_nothing_is_written_twice(sqlite_store, clock):
    study_id = add(sqlite_store)
    mine = claim_one(sqlite_store, study_id, "elsewhere|1|2|a")
    clock[0] = DAY
    other = claim_one(sqlite_store, study_id, "elsewhere|1|2|b")
    assert other.task == mine.task
    with pytest.raises(ClaimLost):
        sqlite_store.beat(mine)
    with pytest.raises(ClaimLost):
        sqlite_store.finish(mine, [], [])
    sqlite_store.beat(other)


def test_a_jump_back_does_not_hold_the_task_of_a_dead_worker_for_a_day(sqlite_store, clock):
    study_id = add(sqlite_store)
    dead = claim_one(sqlite_store, study_id, "elsewhere|1|2|a")
    clock[0] = -60.0  # machines that share a disk may differ so far: the holder lives
    assert claim_one(sqlite_store, study_id, "elsewhere|1|2|b").task != dead.task
    clock[0] = -DAY
    assert claim_one(sqlite_store, study_id, "elsewhere|1|2|c").task == dead.task
    assert not is_stale("elsewhere|1|2|a", AHEAD_SECONDS, 0.0)
    assert is_stale("elsewhere|1|2|a", AHEAD_SECONDS + 1.0, 0.0)
    assert AHEAD_SECONDS > STALE_SECONDS


@pytest.mark.thorough
def test_a_server_that_is_started_anew_in_the_middle(monkeypatch):
    """Killed as by a power failure: what was finished is there, the search ends in one sentence and goes on to the
    same bits."""
    reason = postgres_server.missing()
    if reason:
        pytest.skip(f"no test against PostgreSQL: {reason}")
    done = []
    with postgres_server.server() as folder:
        place = postgres_server.new_database(folder, "own")
        store = Store.open(place)

        def stop_server(task, k):
            done.append((task.method, k))
            if len(done) == 5:
                postgres_server.stop(folder)

        with pytest.raises(StoreError) as caught:
            run(PLAN, objective(), store, to_physical=to_physical, search=FakeSearch(stop_server))
        assert "\n" not in str(caught.value)
        assert "resume the study" in str(caught.value)
        with pytest.raises(StoreError, match="cannot be reached"):
            store.studies()
        postgres_server.start(folder)
        (study,) = store.studies()  # by the store that was open
        kept = store.runs(study.id)
        assert len(kept) == 4
        # the claim that the power failure left is this process's own, which lives: only its silence frees it, and that
        # is a minute
        monkeypatch.setattr("plantfit.study.running.worker_names.STALE_SECONDS", 2.0)
        resume(store, study.id, objective(), to_physical=to_physical, search=FakeSearch())
        whole = store.runs(run(PLAN, objective(), store, to_physical=to_physical, search=FakeSearch()))
        assert bits(store.runs(study.id)) == bits(whole)
        finish_one(store, add(store))
