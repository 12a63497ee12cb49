"""What only a server can do to a study: each one sentence, and what is finished stays."""

import threading
import time

import postgres_server
import pytest
from sqlalchemy import make_url
from test_study_store import PLAN, add, claim_one, finish_one

from plantfit.errors import MissingExtra, StoreError
from plantfit.study import Store, tasks

psycopg = pytest.importorskip("psycopg", reason="no test against PostgreSQL: the package psycopg is not installed")


@pytest.fixture
def place(postgres_url):
    return postgres_url


@pytest.fixture
def admin(place):
    """A second connection to the same database, which commits at once."""
    with psycopg.connect(postgres_server.libpq(place), autocommit=True) as connection:
        yield connection


def said(call):
    with pytest.raises(StoreError) as caught:
        call()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_any_way_to_write_the_address_uses_psycopg(place):
    study_id = add(Store.open(place))
    for begin in ("postgresql://", "postgresql+psycopg://", "postgresql+psycopg2://"):
        assert Store.open(place.replace("postgresql+psycopg://", begin)).study(study_id).name == "gearmotor"
    assert Store.open(Store.open(place).address).study(study_id).id == study_id


def test_a_password_is_never_shown(place):
    store = Store.open(place.replace("plantfit@", "plantfit:secret@"))
    assert "secret" not in store.name
    assert "secret" not in said(lambda: store.study(3))
    assert "secret" in store.address


def test_without_psycopg_the_package_is_named(place, monkeypatch):
    monkeypatch.setattr("plantfit.study.store.database_engine.find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"pip install 'plantfit\[postgres\]'"):
        Store.open(place)


def test_no_server_no_database_no_user(postgres, place, tmp_path):
    assert "cannot be reached" in said(lambda: Store.open(f"postgresql://me@/name?host={tmp_path}"))
    assert "cannot be reached" in said(lambda: Store.open("postgresql://me@127.0.0.1:1/name"))
    assert "does not exist on the server; make it with `createdb`" in said(
        lambda: Store.open(postgres_server.address(postgres, "nosuch"))
    )
    assert "refused the user or the password" in said(lambda: Store.open(place.replace("plantfit@", "stranger@")))


def test_a_database_of_another_program_is_left_alone(place, admin):
    admin.execute("CREATE TABLE customers (name text)")
    assert "another program (it has a table 'customers')" in said(lambda: Store.open(place))
    assert admin.execute("SELECT count(*) FROM pg_tables WHERE schemaname = 'public'").fetchone() == (1,)


def test_what_is_open_for_reading_only_can_be_read(place, admin):
    store = Store.open(place)
    study_id = add(store)
    _, results = finish_one(store, study_id)
    admin.execute(f'ALTER DATABASE "{make_url(place).database}" SET default_transaction_read_only = on')
    other = Store.open(place)
    assert [r.cost for r in other.runs(study_id)] == [r.cost for r in results]
    assert "cannot be written; it is open for reading only" in said(lambda: add(other))


def test_a_user_without_rights(place, admin):
    store = Store.open(place)
    study_id = add(store)
    admin.execute("CREATE ROLE guest LOGIN")
    try:
        guest = place.replace("plantfit@", "guest@")
        assert "cannot be used with your rights" in said(lambda: Store.open(guest))
        admin.execute("GRANT SELECT ON ALL TABLES IN SCHEMA public TO guest")
        assert Store.open(guest).study(study_id).name == "gearmotor"
        assert "cannot be used with your rights" in said(lambda: add(Store.open(guest)))
    finally:
        admin.execute("DROP OWNED BY guest")
        admin.execute("DROP ROLE guest")


def test_a_lock_is_waited_for_then_named(place, admin):
    store = Store.open(place, busy_timeout=0.2)
    study_id = add(store)
    finish_one(store, study_id)
    with admin.transaction():
        admin.execute("LOCK TABLE task IN EXCLUSIVE MODE")
        assert "is locked by another program; close that program" in said(lambda: finish_one(store, study_id))
        assert len(store.runs(study_id)) == 2  # readers go on
    finish_one(store, study_id)
    assert len(store.runs(study_id)) > 2


def test_a_claim_passes_over_a_task_that_another_is_just_taking(place, admin):
    store = Store.open(place, busy_timeout=0.2)
    study_id = add(store)
    with admin.transaction():
        admin.execute("SELECT 1 FROM task WHERE study = %s ORDER BY id LIMIT 1 FOR UPDATE", [study_id])
        claim = claim_one(store, study_id, "elsewhere|1|2|a")
    first, second, *_ = tasks(PLAN)
    assert claim.task == second
    assert claim_one(store, study_id, "elsewhere|1|2|b").task == first


def test_deleting_waits_for_a_claim_and_then_refuses(place, admin):
    store = Store.open(place)
    study_id = add(store)
    told = []
    with admin.transaction():  # a claim that has not committed yet
        admin.execute("SELECT 1 FROM study WHERE id = %s FOR KEY SHARE", [study_id])
        admin.execute(
            "UPDATE task SET claimed_by = 'elsewhere|1|2|a', heartbeat = extract(epoch FROM now()) WHERE study = %s",
            [study_id],
        )
        thread = threading.Thread(target=lambda: told.append(said(lambda: store.delete(study_id))))
        thread.start()
        thread.join(0.3)
        assert thread.is_alive()
    thread.join(20)
    assert "is running; stop it before deleting it" in told[0]


def test_heartbeats_go_by_the_clock_of_the_server(place, monkeypatch):
    """A machine whose clock is an hour slow keeps its tasks, and takes none from others."""
    here = Store.open(place)
    study_id = add(here)
    real = time.time
    monkeypatch.setattr("plantfit.study.store.store.time.time", lambda: real() - 3600)
    slow = Store.open(place)
    claim = claim_one(slow, study_id, "elsewhere|1|2|a")
    monkeypatch.undo()
    assert Store.open(place).held(study_id)[0].silent < 30
    assert claim_one(here, study_id, "elsewhere|1|2|b").task != claim.task


def test_connections_cut_by_the_server_are_made_anew(place, admin):
    store = Store.open(place)
    study_id = add(store)
    admin.execute(
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = current_database() AND pid <> "
        "pg_backend_pid()"
    )
    assert store.study(study_id).name == "gearmotor"


def test_a_server_that_stops_in_the_middle():
    reason = postgres_server.missing()
    if reason:
        pytest.skip(f"no test against PostgreSQL: {reason}")
    with postgres_server.server() as folder:
        store = Store.open(postgres_server.new_database(folder, "own"))
        study_id = add(store)
    assert "cannot be reached" in said(lambda: store.study(study_id))
