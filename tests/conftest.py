"""What all tests share: processes that do not grow without end, and that spend their time on the tests."""

import ctypes
import gc
import os
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

LARGE = 2.0e9  # bytes in use, from which on compiled programs of earlier tests are dropped
MORE = 0.5e9  # bytes by which a process has to grow after that until they are dropped again

_limit = [LARGE]

# Python looks for cycles after every 700 new objects. A fifth of the time of collection went there, and a thirtieth of
# that of the tests.
gc.set_threshold(50_000, 20, 50)

# Some machines keep Python from writing compiled files; every process that a test starts would then compile all of
# plantfit, a second each.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of a test that is marked `further(n)` all cases but the first n are thorough."""
    seen = Counter()
    for item in items:
        own = item.get_closest_marker("further")
        if own is None or item.get_closest_marker("slow") is not None:
            continue
        test = item.nodeid.split("[")[0]
        seen[test] += 1
        if seen[test] > own.args[0]:
            item.add_marker(pytest.mark.thorough)


def pytest_collection_finish():
    """What is there now stays to the end: no search for cycles looks at it again."""
    gc.collect()
    gc.freeze()


def in_use() -> float:
    """Bytes of memory of this process; 0 where the system does not tell."""
    told = Path("/proc/self/statm")
    return int(told.read_text().split()[1]) * 4096.0 if told.exists() else 0.0


def give_back() -> None:
    """Return what was freed to the system, which glibc else keeps."""
    with suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL("libc.so.6").malloc_trim(0)


@pytest.fixture(autouse=True, scope="module")
def _small():
    yield
    if in_use() > _limit[0] and "jax" in sys.modules:
        import jax

        jax.clear_caches()
        gc.collect()
        give_back()
        # a process that stays large else drops them after every module, and makes all anew
        _limit[0] = max(LARGE, in_use() + MORE)
