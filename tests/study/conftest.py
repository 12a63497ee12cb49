"""Fixtures of stores. A module that says `BACKENDS = ("sqlite", "postgresql")` runs its tests with `store` against
both."""

from itertools import count

import pytest

from plantfit.study import Store

_numbers = count(1)


def pytest_generate_tests(metafunc):
    backends = getattr(metafunc.module, "BACKENDS", None)
    if backends and "store" in metafunc.fixturenames:
        metafunc.parametrize("store", backends, indirect=True)


@pytest.fixture(scope="session")
def postgres():
    """The folder of the socket of a private PostgreSQL."""
    import postgres_server

    reason = postgres_server.missing()
    if reason:
        pytest.skip(f"no test against PostgreSQL: {reason}")
    with postgres_server.server() as folder:
        yield folder


@pytest.fixture
def postgres_url(postgres):
    """The address of an empty database."""
    import postgres_server

    return postgres_server.new_database(postgres, f"test_{next(_numbers)}")


@pytest.fixture
def sqlite_store(tmp_path):
    return Store.open(tmp_path / "study.db", busy_timeout=0.2)


@pytest.fixture
def store(request):
    """An empty store that waits 0.2 s for locks: SQLite, or PostgreSQL where the module's BACKENDS say so."""
    if getattr(request, "param", "sqlite") == "postgresql":
        return Store.open(request.getfixturevalue("postgres_url"), busy_timeout=0.2)
    return request.getfixturevalue("sqlite_store")
