import json
import sqlite3
import struct
import threading

import numpy as np
import polars as pl
import pytest
from sqlalchemy import event
from study_fakes import fake_result

from plantfit.errors import Status, StoreError
from plantfit.optimize.contract import RunResult
from plantfit.study import Plan, Store
from plantfit.study.store import claims
from plantfit.study.store.claims import ClaimLost

PLAN = Plan(name="gearmotor", methods=("random", "pso"), runs=3, budget=50, seed=4, chunk=2)
NAMES = ("a", "b", "c")
BACKENDS = ("sqlite", "postgresql")


def add(store, plan=PLAN):
    return store.add(plan, spec_text="name = 'gearmotor'", coordinates=NAMES, probe=b"")


def claim_one(store, study_id, worker="w|1|2|3"):
    claim = store.claim(study_id, worker)
    assert claim is not None
    return claim


def finish_one(store, study_id, worker="w|1|2|3"):
    claim = claim_one(store, study_id, worker)
    results = [fake_result(PLAN, claim.task.method, claim.task.first + k) for k in range(claim.task.count)]
    store.finish(claim, results, [dict(zip(NAMES, r.x.tolist(), strict=True)) for r in results])
    return claim, results


def test_a_study_comes_back_as_it_went_in(store):
    study_id = add(store)
    study = store.study(study_id)
    assert (study.name, study.spec_text, study.coordinates) == ("gearmotor", "name = 'gearmotor'", NAMES)
    assert store.plan(study_id) == PLAN
    assert (study.runs_done, study.runs_total) == (0, 6)
    assert study.created.endswith("+00:00")
    assert {"python", "plantfit", "jax", "numpy", "scipy", "system"} <= set(study.versions)
    assert study.cpu
    assert store.studies() == [study]


def test_every_bit_of_every_float_comes_back(store):
    odd = np.array(
        [
            0.1,
            np.nextafter(1, 2),
            5e-324,
            -0.0,
            np.inf,
            np.nan,
            struct.unpack("<d", b"\x01\x00\x00\x00\x00\x00\xf8\x7f")[0],
        ]
    )
    result = RunResult(
        "random",
        0,
        2**31 - 1,
        odd,
        0.1 + 0.2,
        1e15 / 3,
        1 / 3,
        Status.budget,
        odd,
        odd,
        7,
        {"list": odd[:4], "why": "a"},
    )
    study_id = add(store, Plan(name="p", methods=("random",), runs=1, budget=1))
    store.finish(store.claim(study_id, "w|1|2|3"), [result], [{"a": 5e-324, "b": np.inf, "c": 0.1}])
    run = store.runs(study_id)[0]
    for name in ("x", "history_evaluations", "history_cost"):
        assert getattr(run, name).tobytes() == odd.tobytes()
        assert not getattr(run, name).flags.writeable
    assert (run.cost, run.evaluations, run.seconds, run.seed) == (0.1 + 0.2, 1e15 / 3, 1 / 3, 2**31 - 1)
    assert run.parameters == {"a": 5e-324, "b": np.inf, "c": 0.1}
    assert run.status is Status.budget
    assert store.counts(study_id)[2:] == (1, 1e15 / 3, 0.1 + 0.2)
    assert run.extra == {"list": odd[:4].tolist(), "why": "a"}


@pytest.mark.parametrize("cost", [np.inf, -np.inf, np.nan, -0.0, 5e-324])
def test_odd_costs_keep_every_bit(store, cost):
    study_id = add(store, Plan(name="p", methods=("random",), runs=1, budget=1))
    failed = RunResult("random", 0, 4, np.zeros(3), cost, 1.0, 0.0, Status.failed, np.ones(1), np.array([cost]), 1)
    store.finish(store.claim(study_id, "w|1|2|3"), [failed], [{"a": 0.0}])
    assert struct.pack("<d", store.runs(study_id)[0].cost) == struct.pack("<d", cost)


def test_runs_stand_in_the_order_of_the_plan(store):
    study_id = add(store)
    for _ in range(4):
        finish_one(store, study_id)
    assert [(r.method, r.run) for r in store.runs(study_id)] == [(m, k) for m in ("random", "pso") for k in range(3)]
    assert store.claim(study_id, "w|1|2|3") is None
    assert store.counts(study_id)[:4] == (4, 4, 6, 300.0)


def test_a_task_is_finished_wholly_or_not_at_all(store):
    study_id = add(store)
    claim = store.claim(study_id, "w|1|2|3")
    twice = [fake_result(PLAN, "random", 0)] * 2
    with pytest.raises(StoreError):
        store.finish(claim, twice, [{}, {}])
    assert store.runs(study_id) == []
    assert store.counts(study_id)[:2] == (0, 4)


def test_claims_are_exclusive_and_old_ones_are_taken_over(store, monkeypatch):
    study_id = add(store, Plan(name="p", methods=("random",), runs=1, budget=1))
    first = store.claim(study_id, "elsewhere|1|2|a")
    store.save_checkpoint(first, b"half way")
    assert store.claim(study_id, "elsewhere|1|2|b") is None
    now = claims_time(monkeypatch)
    now[0] += 59
    assert store.claim(study_id, "elsewhere|1|2|b") is None
    now[0] += 2
    second = store.claim(study_id, "elsewhere|1|2|b")
    assert (second.task, second.checkpoint) == (first.task, b"half way")
    for lost in (store.beat, store.release, lambda c: store.save_checkpoint(c, b""), lambda c: store.finish(c, [], [])):
        with pytest.raises(ClaimLost):
            lost(first)
    now[0] += 59
    store.beat(second)
    now[0] += 59
    assert store.claim(study_id, "elsewhere|1|2|c") is None
    store.release(second, b"further")
    assert store.claim(study_id, "elsewhere|1|2|c").checkpoint == b"further"


def test_what_workers_do_is_told(store, monkeypatch):
    study_id = add(store)
    assert store.held(study_id) == []
    first, second = (store.claim(study_id, f"elsewhere|1|2|{name}") for name in "ab")
    now = claims_time(monkeypatch)
    now[0] += 30
    store.beat(second, 120.0)
    now[0] += 5
    one, two = store.held(study_id)
    assert (one.worker, one.task, one.evaluations) == (first.worker, first.task, None)
    assert (two.worker, two.task, two.evaluations) == (second.worker, second.task, 120.0)
    assert one.silent == pytest.approx(35.0, abs=1.0)
    assert two.silent == pytest.approx(5.0, abs=0.1)
    now[0] += 30
    assert [h.worker for h in store.held(study_id)] == [second.worker]
    store.release(second)
    assert store.held(study_id) == []
    with pytest.raises(StoreError, match="no study 77"):
        store.held(77)


def claims_time(monkeypatch):
    import time

    now = [time.time()]
    monkeypatch.setattr("plantfit.study.store.store.time.time", lambda: now[0])
    return now


def test_a_study_whose_worker_died_after_the_last_task_is_done(store):
    study_id = add(store, Plan(name="p", methods=("random",), runs=1, budget=50))
    assert store.study(study_id).state == "interrupted"
    claim = store.claim(study_id, "elsewhere|1|2|a")
    assert store.study(study_id).state == "running"
    store.finish(claim, [fake_result(PLAN, "random", 0)], [{}])
    assert store.study(study_id).state == "done"


def test_what_finishing_found_is_kept_once_under_its_key_and_goes_with_the_study(store):
    number = add(store)
    assert store.finish_of(number, "key") is None
    store.keep_finish(number, "key", b"\0\xff")
    assert Store.open(store.address).finish_of(number, "key") == b"\0\xff"
    assert store.finish_of(number, "other") is None
    store.keep_finish(number, "other", b"new")
    assert (store.finish_of(number, "key"), store.finish_of(number, "other")) == (None, b"new")
    assert Store.open(store.address).finish_of(number, "other") == b"new"
    store.delete(number)
    assert store.finish_of(number, "other") is None
    store.keep_finish(number, "other", b"late")  # a study that is gone keeps nothing, and says nothing
    assert store.finish_of(number, "other") is None


def test_delete(store):
    one, other = add(store), add(store)
    finish_one(store, one)
    finish_one(store, other)
    store.delete(one)
    assert [s.id for s in store.studies()] == [other]
    assert len(store.runs(other)) == 2
    with store.engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM run").scalar() == 2
    assert add(store) > other
    store.claim(other, "elsewhere|1|2|a")
    with pytest.raises(StoreError, match="is running; stop it"):
        store.delete(other)


@pytest.mark.parametrize("call", ["study", "runs", "delete", "plan"])
def test_an_unknown_study_is_named_with_the_known_ones(store, call):
    study_id = add(store)
    with pytest.raises(StoreError, match=rf"no study 77; it has the studies \[{study_id}\]"):
        getattr(store, call)(77)


def test_export_json(store, tmp_path):
    study_id = add(store)
    _, results = finish_one(store, study_id)
    store.export_json(study_id, tmp_path / "s.json")
    record = json.loads((tmp_path / "s.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert record["study"]["plan"] == PLAN.record()
    assert [r["cost"] for r in record["runs"]] == [r.cost for r in results]
    assert record["runs"][0]["history_cost"] == results[0].history_cost.tolist()


def test_export_parquet(store, tmp_path):
    study_id = add(store)
    _, results = finish_one(store, study_id)
    store.export_parquet(study_id, tmp_path / "s.parquet")
    frame = pl.read_parquet(tmp_path / "s.parquet")
    assert frame["cost"].to_list() == [r.cost for r in results]
    assert frame["parameter b"].to_list() == [r.x[1] for r in results]
    assert frame["history_cost"][1].to_list() == results[1].history_cost.tolist()
    assert json.loads(pl.read_parquet_metadata(tmp_path / "s.parquet")["plantfit"])["study"]["name"] == "gearmotor"


@pytest.mark.parametrize("kind", ["export_json", "export_parquet"])
def test_an_empty_study_can_be_exported_and_a_bad_path_is_named(store, tmp_path, kind):
    study_id = add(store)
    getattr(store, kind)(study_id, tmp_path / "empty")
    assert (tmp_path / "empty").stat().st_size > 0
    with pytest.raises(StoreError, match="nowhere") as caught:
        getattr(store, kind)(study_id, tmp_path / "nowhere" / "s")
    assert "\n" not in str(caught.value)


# what can go wrong with the file


def test_a_missing_folder_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(StoreError, match="nowhere does not exist; make the folder"):
        Store.open(tmp_path / "nowhere" / "s.db")
    with pytest.raises(StoreError, match=r"s\.db does not exist"):
        Store.open(tmp_path / "s.db", create=False)
    assert not (tmp_path / "s.db").exists()
    with pytest.raises(StoreError, match="is a folder"):
        Store.open(tmp_path)
    for memory in ("sqlite://", "sqlite:///:memory:", ":memory:"):
        with pytest.raises(StoreError, match="outlive"):
            Store.open(memory)


def test_a_url_is_as_good_as_a_path(tmp_path):
    study_id = add(Store.open(f"sqlite:///{tmp_path}/s.db"))
    assert Store.open(tmp_path / "s.db", create=False).study(study_id).name == "gearmotor"


def test_an_address_that_cannot_be_used_is_named():
    with pytest.raises(StoreError, match="SQLite or PostgreSQL, not in 'mysql'") as caught:
        Store.open("mysql://user:secret@host/name")
    assert "secret" not in str(caught.value)
    with pytest.raises(StoreError, match="cannot be read"):
        Store.open("://")


def test_a_file_that_is_no_database(tmp_path):
    (tmp_path / "notes.db").write_text("these are my notes " * 100)
    with pytest.raises(StoreError, match=r"notes\.db is not a study database; choose another file"):
        Store.open(tmp_path / "notes.db")


def test_a_database_of_another_program_is_left_alone(tmp_path):
    with sqlite3.connect(tmp_path / "other.db") as other:
        other.execute("CREATE TABLE customers (name)")
    with pytest.raises(StoreError, match="another program"):
        Store.open(tmp_path / "other.db")
    with sqlite3.connect(tmp_path / "other.db") as other:
        assert other.execute("SELECT name FROM sqlite_master").fetchall() == [("customers",)]


def test_a_damaged_file(tmp_path):
    path = tmp_path / "s.db"
    study_id = add(Store.open(path))
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    whole = path.read_bytes()
    path.write_bytes(whole[:4096] + b"\xff" * (len(whole) - 4096))
    with pytest.raises(StoreError, match=r"s\.db is damaged; restore it"):
        Store.open(path).runs(study_id)


def test_a_locked_database_waits_then_says_so(sqlite_store):
    store = sqlite_store
    study_id = add(store)
    finish_one(store, study_id)
    holder = sqlite3.connect(store.name, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreError, match=r"study\.db is locked by another program; close that program"):
        add(store)
    assert len(store.runs(study_id)) == 2  # readers go on
    holder.execute("ROLLBACK")
    holder.close()
    assert add(store) > study_id


def test_a_new_database_that_another_one_makes_now_is_waited_for(tmp_path):
    """SQLite itself does not wait when it begins a log of writes."""
    place = tmp_path / "fresh.db"
    holder = sqlite3.connect(place, isolation_level=None, check_same_thread=False)
    holder.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreError, match=r"fresh\.db is locked by another program"):
        Store.open(place, busy_timeout=0.1)
    ends = threading.Timer(0.3, lambda: holder.execute("COMMIT"))
    ends.start()
    assert add(Store.open(place, busy_timeout=20.0)) == 1
    ends.join()
    holder.close()


def test_a_read_only_database_says_so(sqlite_store):
    store = sqlite_store
    study_id = add(store)
    event.listen(store.engine, "connect", lambda connection, _: connection.execute("PRAGMA query_only = ON"))
    with pytest.raises(StoreError, match=r"study\.db cannot be written; allow writing"):
        add(store)
    assert store.study(study_id).name == "gearmotor"


def test_a_database_that_cannot_be_written_can_still_be_read(sqlite_store):
    store = sqlite_store
    study_id = add(store)
    finish_one(store, study_id)
    holder = sqlite3.connect(store.name, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")  # whoever holds the write lock: reading needs none
    assert len(Store.open(store.name, busy_timeout=0.1).runs(study_id)) == 2
    holder.close()


@pytest.mark.parametrize(
    "change",
    ["x = '\\x00'", "history_cost = '\\x00'", "packing = 9", "status = 'odd'", "extra = '{'", "method = 'gone'"],
)
def test_a_row_that_cannot_be_read_is_a_sentence(store, change):
    study_id = add(store)
    finish_one(store, study_id)
    if store.engine.dialect.name == "sqlite":
        change = change.replace("'\\x", "x'")
    with store.engine.begin() as connection:
        connection.exec_driver_sql(f"UPDATE run SET {change} WHERE run = 1")
    with pytest.raises(StoreError, match=rf"Study {study_id} in .* has a row that cannot be read") as caught:
        store.runs(study_id)
    assert "\n" not in str(caught.value)


def test_a_full_disk_says_so_and_keeps_what_was_finished(sqlite_store):
    store = sqlite_store
    study_id = add(store)
    _, results = finish_one(store, study_id)
    pages = [0]
    event.listen(
        store.engine, "connect", lambda connection, _: connection.execute(f"PRAGMA max_page_count = {pages[0]}")
    )
    with store.engine.connect() as connection:
        pages[0] = connection.exec_driver_sql("PRAGMA page_count").scalar()
    claim = store.claim(study_id, "w|1|2|3")
    with pytest.raises(StoreError, match=r"study\.db cannot grow because the disk is full; free some space"):
        store.save_checkpoint(claim, bytes(2**20))
    pages[0] = 2**20
    assert [r.cost for r in store.runs(study_id)] == [r.cost for r in results]
    store.save_checkpoint(claim, bytes(2**20))
    store.release(claim)
    assert store.claim(study_id, "w|1|2|4").checkpoint == bytes(2**20)


def test_utc_now_says_its_zone():
    assert claims.utc_now().endswith("+00:00")
