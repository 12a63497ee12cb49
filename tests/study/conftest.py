import pytest

from plantfit.study import Store


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "study.db", busy_timeout=0.2)
