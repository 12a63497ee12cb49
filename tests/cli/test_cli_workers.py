"""Several worker processes, a cluster and several studies from the command line."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from cli_call import SPEC, call, heater

from plantfit.study import Store
from plantfit.study.running.worker_names import new_worker

SEARCH = 'seed = 3\nmethods = ["pso", "random"]\nruns = 6\nbudget = 300\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    heater(tmp_path)
    (tmp_path / "heater.toml").write_text(SPEC.replace("seed = 3\n", SEARCH))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def found(store, number=1):
    """Everything of the runs of a study but their times."""
    exact = ("method", "run", "cost", "evaluations", "status")
    return [
        (*(getattr(r, name) for name in exact), r.x.tobytes(), r.history_cost.tobytes())
        for r in Store.open(store).runs(number)
    ]


@pytest.mark.thorough
def test_helpers_a_cluster_and_one_process_find_the_same(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "run", "heater.toml", "--store", "one.db", "--json")
    assert said.code == 0, said.err
    (folder / "two.toml").write_text((folder / "heater.toml").read_text().replace('"heater"', '"second"', 1))
    said = call(capsys, monkeypatch, "run", "heater.toml", "two.toml", "--workers", "2", "--store", "two.db")
    assert said.code == 0, said.err
    assert said.out.index("heater\n") < said.out.index("Report: heater.html") < said.out.index("second\n")
    assert "Report: second.html" in said.out
    said = call(
        capsys,
        monkeypatch,
        "run",
        "heater.toml",
        "--scheduler",
        "local",
        "--workers",
        "1",
        "--store",
        "three.db",
        "--json",
    )
    assert said.code == 0, said.err
    assert json.loads(said.out)["name"] == "heater"
    assert found("one.db") == found("two.db", 1) == found("two.db", 2) == found("three.db")
    assert len(found("one.db")) == 12


@pytest.mark.skipif(os.name != "posix", reason="needs signals of POSIX, which this system lacks")
@pytest.mark.thorough
def test_ctrl_c_stops_helpers_too_and_resume_goes_on_with_several(folder, capsys, monkeypatch):
    slow = (folder / "heater.toml").read_text().replace("budget = 300", "budget = 500000000")
    for name in ("heater", "second"):
        (folder / f"{name}.toml").write_text(slow.replace('"heater"', f'"{name}"', 1))
    words = [
        sys.executable,
        "-c",
        "from plantfit.cli.main import run_cli; run_cli()",
        "run",
        "heater.toml",
        "second.toml",
        "--workers",
        "2",
    ]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        limit = time.monotonic() + 100
        held = []
        while len(held) < 2:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < limit, "nobody came to work"
            time.sleep(0.1)
            if os.path.exists("plantfit.db"):
                store = Store.open("plantfit.db")
                held = [h for s in store.studies() for h in store.held(s.id)]
        told = json.loads(call(capsys, monkeypatch, "workers", "--json").out)
        assert {int(t["worker"].split()[1]) for t in told} >= {process.pid}
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=100)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    assert "study 1 (heater) is saved with" in err
    assert "go on with `plantfit resume 1 2`" in err
    assert "Traceback" not in err
    # pyrefly: ignore[unbound-name]  (opened while two were held)
    assert [h for s in store.studies() for h in store.held(s.id)] == []
    assert "Nobody works here now" in call(capsys, monkeypatch, "workers").out


def test_workers_says_who_does_what(folder, capsys, monkeypatch):
    from plantfit.study import Plan

    store = Store.open("plantfit.db")
    study_id = store.add(
        Plan(name="pump", methods=("random",), runs=10, budget=100), spec_text=None, coordinates=("a",), probe=b""
    )
    claim = store.claim(study_id, new_worker("tcp://10.0.0.5:4444"))
    store.claim(study_id, new_worker())
    assert claim is not None
    store.beat(claim, 250.0)
    said = " ".join(call(capsys, monkeypatch, "workers").out.split())
    assert "1 pump tcp://10.0.0.5:4444 random runs 0 to 4 50 %" in said
    assert f"process {os.getpid()} on" in said
    assert "random runs 5 to 9 begins" in said
    first, second = json.loads(call(capsys, monkeypatch, "workers", "1", "--json").out)
    assert (first["worker"], first["evaluations"], second["evaluations"]) == ("tcp://10.0.0.5:4444", 250.0, None)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--workers", "none"), "--workers none cannot be used; give a number from 1 to 1024, or auto"),
        (("--workers", "0"), "--workers 0 cannot be used"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "leave --workers out"),
        (("--scheduler", "tcp://127.0.0.1:1"), "No dask scheduler answers at 'tcp://127.0.0.1:1'"),
        (("heater.toml",), "2 of the studies, 'heater' among them, would write the report heater.html"),
        (("other.toml", "--out", "both.html"), "--out both.html names one report, but there are 2 studies"),
    ],
)
@pytest.mark.further(3)
def test_one_sentence_each(folder, capsys, monkeypatch, words, part):
    (folder / "other.toml").write_text((folder / "heater.toml").read_text().replace('"heater"', '"other"', 1))
    said = call(capsys, monkeypatch, "run", "heater.toml", *words)
    assert said.code == 8
    assert not os.path.exists("plantfit.db") or Store.open("plantfit.db").studies() == []  # nothing was begun
    assert part in " ".join(said.err.split())
    assert "Traceback" not in said.err
