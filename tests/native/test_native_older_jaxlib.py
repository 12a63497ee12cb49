"""The real jaxlib 0.8.0, which serves another interface than native loops are written for: scans, one sentence, and
never a crash.

0.8.0 and older ended in a segmentation fault at the first native loop. `jax>=0.10.2` keeps pip from installing them;
  whoever has one
all the same gets an answer.
"""

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from test_native_interface import LOOP

sys.path.append(str(Path(__file__).parents[1] / "cli"))
from cli_call import heater

VERSION = "0.8.0"
FIT = """
import sqlite3, sys
sys.argv = ["plantfit", "run", "heater.toml", "--store", "s.db", "--out", "s.html"]
from plantfit.cli.main import run_cli
try:
    run_cli()
except SystemExit as end:
    assert not end.code, end.code
print(sqlite3.connect("s.db").execute("SELECT versions FROM study").fetchone()[0])
print(sqlite3.connect("s.db").execute("SELECT parameters FROM run ORDER BY cost").fetchone()[0])
"""


@pytest.mark.slow
def test_jaxlib_0_8_0_ends_in_scan_with_one_sentence(tmp_path):
    place = tmp_path / "older"
    words = [
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--target",
        str(place),
        f"jax=={VERSION}",
        f"jaxlib=={VERSION}",
    ]
    got = subprocess.run([sys.executable, "-m", "pip", "install", *words], capture_output=True, text=True)
    if got.returncode:
        pytest.skip(f"jaxlib {VERSION} cannot be installed here: {got.stderr.strip().splitlines()[-1]}")
    assert version("jaxlib") != VERSION  # what the other tests run on
    paths = os.pathsep.join([str(place), *(p for p in sys.path if p)])
    environment = os.environ | {"PYTHONPATH": paths, "PLANTFIT_CACHE": str(tmp_path / "cache")}
    environment.pop("PLANTFIT_NATIVE", None)

    def ended(code, environment=environment):
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=environment, timeout=900
        )
        assert done.returncode == 0, (done.returncode, done.stderr)
        return done

    def lines(code):
        return ended(code).stdout.splitlines()

    assert lines("import jaxlib, importlib.metadata as m; print(jaxlib.__version__, m.version('jaxlib'))") == [
        f"{VERSION} {VERSION}"
    ]
    result, *told = lines(LOOP.format(change=""))
    assert result == "4.3125 scan False"
    (sentence,) = told
    assert sentence.startswith(f"Native loops do not run with jaxlib {VERSION} (XLA does not serve version")
    assert "XLA scans" in sentence

    heater(tmp_path)  # and a whole study
    text = (tmp_path / "heater.toml").read_text("utf-8") + 'methods = ["least_squares"]\nruns = 1\nbudget = 60\n'
    (tmp_path / "heater.toml").write_text("diagnose = false\n" + text, "utf-8")
    done = ended(FIT)
    assert done.stderr.count("Native loops do not run") == 1
    *_, versions, theirs = done.stdout.splitlines()
    assert (json.loads(versions)["engine"], json.loads(versions)["jaxlib"]) == ("scan", VERSION)
    (tmp_path / "s.db").unlink()
    ours = ended(FIT, os.environ | {"PLANTFIT_CACHE": str(tmp_path / "cache2")}).stdout.splitlines()[-1]
    assert json.loads(theirs) == pytest.approx(json.loads(ours), rel=1e-6)
