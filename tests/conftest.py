"""What all tests share: processes that do not grow without end."""

import gc
from pathlib import Path

import pytest

LARGE = 2.0e9  # bytes in use, from which on compiled programs of earlier tests are dropped


def in_use() -> float:
    """Bytes of memory of this process; 0 where the system does not tell."""
    told = Path("/proc/self/statm")
    return int(told.read_text().split()[1]) * 4096.0 if told.exists() else 0.0


@pytest.fixture(autouse=True, scope="module")
def _small():
    yield
    if in_use() > LARGE:
        import jax

        jax.clear_caches()
        gc.collect()
