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


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_a_study_is_meant_by_its_file_its_name_or_its_number(folder, capsys, monkeypatch):
    """ "`plantfit combine` writes the study file in these combinations" was said of gain.toml, and `plantfit combine
    gain.toml` answered "unable to parse string as an integer"."""
    other = SPEC.replace('"gain"', '"other"')
    (folder / "other.toml").write_text(other)
    call(capsys, monkeypatch, "run", "gain.toml")
    call(capsys, monkeypatch, "run", "other.toml")  # the newest
    for given in ("gain.toml", "gain", "1"):
        said = call(capsys, monkeypatch, "combine", given, "--force")
        assert said.code == 0
        assert "Written: gain-combined.toml" in said.out
    assert "Report: gain.html" in call(capsys, monkeypatch, "report", "gain.toml").out
    assert "Study 1 (gain)" in call(capsys, monkeypatch, "export-study", "gain.toml").out


@pytest.mark.parametrize(("given", "told"), [
    ("fresh.toml", "holds no study of 'fresh.toml'; `plantfit run fresh.toml` makes one"),
    ("nowhere.toml", "There is no file 'nowhere.toml'; `plantfit list` shows what is stored"),
    ("broken.toml", "'broken.toml' cannot be read as a study file"),
    ("log.csv", "'log.csv' is no study file; give the number, the name or the .toml file of a study"),
    ("unknown", "'unknown' is neither a study file here nor a study in"),
])  # fmt: skip
def test_a_study_that_there_is_not_is_named(given, told, folder, capsys, monkeypatch):
    (folder / "fresh.toml").write_text(SPEC.replace('"gain"', '"fresh"'))
    (folder / "broken.toml").write_text("name = gain")
    (folder / "log.csv").write_text("t,u\n0,1\n")
    call(capsys, monkeypatch, "run", "gain.toml")
    said = call(capsys, monkeypatch, "combine", given)
    assert said.code != 0
    assert told in " ".join(said.err.split())
