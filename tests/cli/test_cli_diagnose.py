"""`plantfit diagnose`: what it says, what it writes, what it refuses."""

import json

from cli_call import call, heater

from plantfit.spec import load


def undelayed(folder):
    """The heater's study with a model that lacks its dead time."""
    place = heater(folder)
    text = place.read_text().replace("delay(u, L)", "u")
    place.write_text(text[: text.index("[parameters.L]")] + "[search]\nbudget = 1000\nseed = 3\n")
    return place


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
