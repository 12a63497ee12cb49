"""`plantfit diagnose`: what it says, what it writes, what it refuses."""

import json

import numpy as np
import pytest
from cli_call import call, heater

from plantfit.spec import load


def undelayed(folder):
    """The heater's study with a model that lacks its dead time."""
    place = heater(folder)
    text = place.read_text().replace("delay(u, L)", "u")
    place.write_text(text[: text.index("[parameters.L]")] + "[search]\nbudget = 1000\nseed = 3\n")
    return place


@pytest.mark.thorough
def test_a_missing_dead_time_is_named_and_written(tmp_path, capsys, monkeypatch):
    place = undelayed(tmp_path)
    said = call(capsys, monkeypatch, "diagnose", place)
    assert said.code == 0, said.err
    line = said.out.splitlines()[0]
    assert "dead time of 3.4" in line
    assert "very likely missing" in line
    made = tmp_path / "heater-with-dead-time-of-u.toml"
    assert str(made.name) in said.out
    problem = load(made).problem
    assert problem.space.upper[problem.space.names.index("dead_time_u")] > 3.4
    again = call(capsys, monkeypatch, "diagnose", place)
    assert again.code == 7
    assert "exists already" in again.err


@pytest.mark.thorough
def test_as_json_and_of_a_complete_model(tmp_path, capsys, monkeypatch):
    place = heater(tmp_path)
    place.write_text(place.read_text() + "budget = 1000\n")
    said = call(capsys, monkeypatch, "diagnose", place, "--json")
    record = json.loads(said.out)
    assert [v["level"] for v in record["verdict"]] == ["good"]
    assert record["write"] == []
    assert "file" not in record
    assert "dead time of u" not in {t["name"] for t in record["rounds"][0]["tried"]}  # the model has one
    assert max(t["explained"] for t in record["rounds"][0]["tried"]) < 0.05


def test_what_cannot_be_tried_is_said(tmp_path, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "diagnose", undelayed(tmp_path), "--try", "ded time of u")
    assert said.code == 5
    assert "Did you mean 'dead time of u'" in said.err
    assert not list(tmp_path.glob("*-with-*"))


CAR = """name = "car"
[recording.road]
file = "car.csv"
time = "t"
signals = { F = "F", grade = "grade", v = "v" }
units = { F = "N", grade = "", v = "m/s" }
[model]
equations = "x' = F/m - 9.81*grade - r; v = x"
check_units = false
states = { x = { unit = "m/s", initial = "v" } }
inputs = { F = "N", grade = "" }
outputs = { v = "m/s" }
[parameters]
m = { bounds = [500, 5000], unit = "kg" }
r = { bounds = [0, 1], unit = "m/s^2" }
[search]
budget = 600
"""


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.thorough
def test_a_column_with_a_wrong_sign_is_told_first(tmp_path, capsys, monkeypatch, sign):
    rng = np.random.default_rng(2)
    t = 0.5 * np.arange(400)
    force, grade = np.repeat(rng.choice([0.0, 600.0, 1500.0], 20), 20), 0.04 * np.sin(t / 9)
    v = 20 + 0.5 * np.concatenate([[0.0], np.cumsum((force / 1500 - 9.81 * np.interp(t + 0.25, t, grade) - 0.4)[:-1])])
    rows = np.column_stack([t, force, sign * np.interp(t + 0.25, t, grade), v + 0.05 * rng.normal(size=400)])
    np.savetxt(tmp_path / "car.csv", rows, delimiter=",", header="t,F,grade,v", comments="")
    place = tmp_path / "car.toml"
    place.write_text(CAR)
    said = call(capsys, monkeypatch, "diagnose", place, "--force")
    assert said.code == 0, said.err
    told = "With the other sign of grade the model follows the record"
    assert (told in said.out.splitlines()[0]) == (sign < 0)
    assert (told in said.out) == (sign < 0)
    assert "Nothing else was tried" not in said.out
    asked = call(capsys, monkeypatch, "diagnose", place, "--try", "offset of v", "--force")
    assert told not in asked.out
