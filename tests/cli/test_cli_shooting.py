"""`shooting` in a study file: a record of 40 periods, which plain fits from the same start do not follow."""

import json

import numpy as np
import pytest
from cli_call import call

STUDY = """\
name = "ringing"
[recording.bench]
file = "ringing.csv"
time = "t [s]"
signals = { y = "y [mm]" }
[model]
equations = \"\"\"
x' = v
v' = -w^2*x - 2*d*v
y = x
\"\"\"
inputs = []
states = { x = { unit = "mm", initial = "x0" }, v = { unit = "mm/s", initial = 0 } }
outputs = { y = "mm" }
[parameters]
w = { bounds = [2.0, 40.0], unit = "rad/s" }
d = { bounds = [0.0, 1.0], unit = "1/s" }
x0 = { bounds = [0.5, 2.0], unit = "mm" }
[search]
methods = ["lbfgsb"]
settings = { lbfgsb = { max_steps = 30 } }
budget = 100
seed = 5
"""


def write(folder, shooting):
    t = np.arange(0.0, 20.0, 0.01)
    w, d = 4 * np.pi, 0.03
    fast = np.sqrt(w**2 - d**2)
    y = np.exp(-d * t) * (np.cos(fast * t) + d / fast * np.sin(fast * t)) + np.random.default_rng(0).normal(
        0, 0.02, len(t)
    )
    (folder / "ringing.csv").write_text(
        "\n".join(["t [s],y [mm]", *(f"{a:.2f},{b:.6f}" for a, b in zip(t, y, strict=True))])
    )
    (folder / "study.toml").write_text(STUDY + (f"shooting = {shooting}\n" if shooting else ""))
    return w


@pytest.mark.parametrize("shooting", [None, 80])
@pytest.mark.further(1)
def test_a_study_begins_where_shooting_ends(tmp_path, monkeypatch, capsys, shooting):
    monkeypatch.chdir(tmp_path)
    w = write(tmp_path, shooting)
    said = call(capsys, monkeypatch, "run", "study.toml", "--no-diagnose", "--json")
    assert said.code == 0, said.err
    found = {p["name"]: p["value"] for p in json.loads(said.out)["parameters"]}
    assert (abs(found["w"] - w) < 0.01) == bool(shooting)


@pytest.mark.parametrize("shooting", [None, 80])
@pytest.mark.further(1)
def test_a_diagnosis_begins_where_shooting_ends(tmp_path, monkeypatch, capsys, shooting):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, shooting)
    said = call(capsys, monkeypatch, "diagnose", "study.toml", "--try", "offset of y", "--json")
    assert said.code == 0, said.err
    left = json.loads(said.out)["rounds"][0]["tried"][0]["rmse_with"]
    assert (left < 0.025) == bool(shooting), left


def test_shooting_must_be_a_whole_number_of_segments(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY + "shooting = 0\n")
    said = call(capsys, monkeypatch, "run", "study.toml")
    assert said.code != 0
    assert "search.shooting = 0" in said.err
