"""`plantfit combine`: from a study that the data do not determine to one that they do."""

import json

import numpy as np
import pytest
from cli_call import call

SPEC = """
name = "gain"
[recording.bench]
file = "bench.csv"
period = 1.0
[model]
equations = "y = K*c*u"
inputs = ["u"]
outputs = ["y"]
[parameters.K]
bounds = [0.1, 9]
[parameters.c]      # kept out of the report
bounds = [0.1, 9]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    rng = np.random.default_rng(8)
    u = rng.uniform(1, 2, 100)
    np.savetxt(
        tmp_path / "bench.csv",
        np.c_[u, 3 * u + 0.01 * rng.standard_normal(100)],
        delimiter=",",
        header="u,y",
        comments="",
    )
    (tmp_path / "gain.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_new_file_runs_and_is_determined(folder, capsys, monkeypatch):
    first = call(capsys, monkeypatch, "run", "gain.toml")
    assert "`plantfit combine`" in " ".join(first.out.split())
    said = call(capsys, monkeypatch, "combine")
    assert said.code == 0
    assert "new: K_c = K*c" in said.out
    assert "plantfit run gain-combined.toml" in said.out
    record = json.loads(call(capsys, monkeypatch, "run", "gain-combined.toml", "--json").out)
    (own,) = [p for p in record["parameters"] if p["name"] == "K_c"]
    assert own["status"] == "determined"
    assert own["low"] < 3.0 < own["high"]
    again = call(capsys, monkeypatch, "combine", "1")
    assert again.code != 0
    assert "gain-combined.toml' exists already" in " ".join(again.err.split())
    told = json.loads(call(capsys, monkeypatch, "combine", "1", "--force", "--json").out)
    assert told["made"] == {"K_c": "K*c"}
    assert len(told["held"]) == 1
    nothing = call(capsys, monkeypatch, "combine", "2", "--out", "other.toml")
    assert nothing.code != 0
    assert "nothing has to be changed" in " ".join(nothing.err.split())
    assert not (folder / "other.toml").exists()
    lost = call(capsys, monkeypatch, "combine", "1", "--out", "no/such/folder.toml")
    assert lost.code != 0
    assert "cannot be written" in " ".join(lost.err.split())
    assert "Traceback" not in lost.err
