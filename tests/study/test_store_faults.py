"""The store on a disk that fails, and in a process that ends, at every write, sync, truncation, rename and removal
of a study."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)


def tried(tmp_path, stride):
    library = tmp_path / "faults.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(HERE / "faults.c"), "-ldl"],
        check=True,
        capture_output=True,
    )
    environment = os.environ | {"LD_PRELOAD": str(library)}
    words = [sys.executable, str(HERE / "faulty_disk.py"), str(library), str(tmp_path / "disk"), str(stride)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment, cwd=HERE, timeout=3000)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.thorough
def test_some_faults_lose_nothing(tmp_path):
    told = tried(tmp_path, 59)
    assert told["found"] == []
    assert told["calls"] > 50  # the library counts
    assert min(told["trials"].values()) > 3


@pytest.mark.slow
def test_no_fault_loses_anything(tmp_path):
    told = tried(tmp_path, 1)
    assert told["found"] == []
    assert set(told["trials"].values()) == {told["calls"]}
