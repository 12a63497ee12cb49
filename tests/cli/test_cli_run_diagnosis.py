"""`plantfit run` names what is missing in a model, leaves clean records alone, and can be stopped in it without
losing the answer."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest
from cli_call import call, heater

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

from plantfit.trust.diagnosis import phase

GUESSES = ("look for disturbances", "response to it is incomplete", "a drift, or an offset that changed")


def planted(folder, plant, fault, seed=5):
    """The study of a plant with a fault that its model lacks."""
    place = write(PLANTS[plant], fault, 0.02, seed, folder)
    place.write_text(place.read_text() + "[search]\nbudget = 600\n")
    return place


def run(capsys, monkeypatch, place, *words):
    monkeypatch.chdir(place.parent)
    said = call(capsys, monkeypatch, "run", place.name, *words)
    assert said.code == 0, said.err
    return said


def as_json(capsys, monkeypatch, place, *words):
    return json.loads(run(capsys, monkeypatch, place, "--json", *words).out)


def named(findings):
    return [v["sentence"] for v in findings["verdict"] if "missing" in v["sentence"] and "explains" in v["sentence"]]


@pytest.mark.parametrize(
    ("plant", "fault", "words"),
    [
        pytest.param("first", "dead_time", "dead time of", marks=pytest.mark.slow),  # test_cli_diagnose.py has it too
        ("second", "coulomb", "dry friction of"),
        ("first", "sensor_high", "upper end at"),
    ],
)
@pytest.mark.thorough
def test_what_is_missing_is_named_in_verdict_and_report(plant, fault, words, tmp_path, capsys, monkeypatch):
    found = as_json(capsys, monkeypatch, planted(tmp_path, plant, fault))
    (first, *_) = named(found)
    assert words in first.lower()
    assert "very likely missing" in first
    assert "unseen data" in first
    assert found["diagnosis"]["rounds"][0]["found"]
    assert "residuals" not in found["diagnosis"]  # samples are in the report
    assert found["diagnosis"]["evaluations"] <= found["diagnosis"]["allowed"] * 1.2
    said = " ".join(v["sentence"] for v in found["verdict"])
    assert not [g for g in GUESSES if g in said]
    page = (tmp_path / f"{plant}.html").read_text()
    assert "What may be missing" in page
    assert found["diagnosis"]["next"].startswith("plantfit run study.toml --try ")
    clipped = [look for look in found["data"] if look["kind"] == "clipped"]
    assert bool(clipped) == (fault == "sensor_high")
    assert ("Looks at the data" in page) == bool(found["data"])
    assert all(look["begin"] <= look["end"] for look in clipped)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clean_record_gets_no_warning_and_costs_nothing(seed, tmp_path, capsys, monkeypatch):
    place = planted(tmp_path, "first", "clean", seed)
    done = []
    monkeypatch.setattr(phase, "diagnose", lambda *given, **more: done.append(given))
    found = as_json(capsys, monkeypatch, place)
    white = all(t["white"] for t in found["residual_tests"])
    assert white  # of these seeds; one in a hundred is not by chance
    assert not done
    assert found["diagnosis"] is None
    assert not named(found)
    assert "What may be missing" not in (tmp_path / "first.html").read_text()


@pytest.mark.thorough
def test_a_diagnosis_can_be_turned_off_stopped_and_made_later_with_the_same_bits(tmp_path, capsys, monkeypatch):
    place = planted(tmp_path, "first", "dead_time")
    real = phase.diagnose
    monkeypatch.setattr(phase, "diagnose", lambda *given, **more: pytest.fail("not asked for"))
    off = as_json(capsys, monkeypatch, place, "--no-diagnose", "--workers", "2")
    assert off["diagnosis"] is None
    assert any("something systematic is missing" in v["sentence"] for v in off["verdict"])

    def interrupted(*given, **more):
        os.kill(os.getpid(), signal.SIGINT)
        return real(*given, **more)

    monkeypatch.setattr(phase, "diagnose", interrupted)
    said = run(capsys, monkeypatch, place)
    assert "the answer is kept" in said.err
    assert "was stopped; `plantfit diagnose study.toml` does it" in said.out
    page = (tmp_path / "first.html").read_text()
    assert "was stopped; " in page  # on top of the page; a section with the same sentence would be empty but for it
    assert "What may be missing" not in page

    monkeypatch.setattr(phase, "diagnose", real)
    later = [json.loads(call(capsys, monkeypatch, "report", number, "--json").out) for number in ("1", "2")]
    for one in later:  # searched by two workers, and by one that was stopped afterwards
        assert {p["name"]: p["value"] for p in one["parameters"]} == {p["name"]: p["value"] for p in off["parameters"]}
        assert named(one)
    assert later[0]["diagnosis"] == later[1]["diagnosis"]
    again = as_json(capsys, monkeypatch, place)
    assert again["diagnosis"] == later[0]["diagnosis"]
    assert again["verdict"] == later[0]["verdict"]


def test_the_study_file_can_turn_it_off(tmp_path, capsys, monkeypatch):
    place = planted(tmp_path, "first", "dead_time")
    place.write_text("diagnose = false\n" + place.read_text())
    monkeypatch.setattr(phase, "diagnose", lambda *given, **more: pytest.fail("not asked for"))
    assert as_json(capsys, monkeypatch, place)["diagnosis"] is None


def undelayed(folder):
    """The heater's study with a model that lacks its dead time."""
    place = heater(folder)
    text = place.read_text().replace("delay(u, L)", "u")
    place.write_text(text[: text.index("[parameters.L]")] + "[search]\nbudget = 600\nseed = 3\n")
    return place


@pytest.mark.thorough
def test_try_keeps_the_study_file_with_the_addition_and_runs_it(tmp_path, capsys, monkeypatch):
    place = undelayed(tmp_path)
    said = run(capsys, monkeypatch, place, "--try", "dead time of u", "--json")
    made = tmp_path / "heater-with-dead-time-of-u.toml"
    assert made.exists()
    found = json.loads(said.out)
    assert found["name"] == "heater with dead time of u"
    (value,) = [p["value"] for p in found["parameters"] if p["name"] == "dead_time_u"]
    assert abs(value - 3.4) < 0.1
    assert found["diagnosis"] is None or not named(found)
    made.write_text(made.read_text() + "# mine\n")
    again = call(capsys, monkeypatch, "run", place.name, "--try", "dead time of u")
    assert again.code == 7
    assert "exists already" in again.err


def test_an_addition_that_there_is_not_is_told_before_the_search(tmp_path, capsys, monkeypatch):
    place = undelayed(tmp_path)
    monkeypatch.setattr("plantfit.fitting.fit", lambda *given, **more: pytest.fail("fitted"))
    said = call(capsys, monkeypatch, "run", place, "--try", "ded time of u")
    assert said.code == 5
    assert len(said.err.strip().splitlines()) == 1
    assert "Did you mean 'dead time of u'" in said.err
    assert "backlash of u" in said.err
    assert not list(tmp_path.glob("*-with-*"))
    two = call(capsys, monkeypatch, "run", place, place, "--try", "dead time of u")
    assert two.code == 7
    assert "one study file" in two.err
