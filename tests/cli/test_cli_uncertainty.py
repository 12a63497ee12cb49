"""A study file with stated errors, from `check` to a report made again from an exported study."""

import json
import re

import numpy as np
import pytest
from cli_call import call, heater

import plantfit as pf
from plantfit.trust import propagate

STATED = """
[uncertainty.thermometer]
of = "T"
kind = "gain"
limit = 1
unit = "%"
[uncertainty."cold junction"]
of = "T"
kind = "offset"
repeats = [0.1, 0.3, 0.2]
[uncertainty.clock]
of = "clock"
limit = 100
unit = "ppm"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = heater(tmp_path)
    place.write_text(place.read_text() + STATED)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_check_shows_the_budget_without_a_fit(folder, capsys, monkeypatch):
    record = json.loads(call(capsys, monkeypatch, "check", "heater.toml", "--json").out)
    budget, clock = record["uncertainty"]
    largest = np.loadtxt(folder / "heater.csv", delimiter=",", skiprows=1)[:, 2].max()
    assert budget["at"] == largest
    assert budget["combined"] == pytest.approx(np.hypot(largest * 0.01 / np.sqrt(3), 0.1 / np.sqrt(3)))
    assert clock["of"] == "clock"
    said = call(capsys, monkeypatch, "check", "heater.toml")
    assert "One reading of T" in said.out
    assert "cold junction" in said.out
    assert "expanded, k = 2" in said.out
    assert not (folder / "plantfit.db").exists()
    (folder / "heater.toml").write_text((folder / "heater.toml").read_text().replace('of = "T"', 'of = "Tx"', 1))
    said = call(capsys, monkeypatch, "check", "heater.toml")
    assert said.code == 7
    assert "heater.toml, [uncertainty.thermometer]: of = 'Tx' is not a signal" in said.err
    assert "did you mean 'T'" in said.err
    assert "Traceback" not in said.err


@pytest.mark.thorough
def test_run_export_import_and_report_keep_the_table(folder, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "run", "heater.toml")
    assert said.code == 0, said.err
    wider = re.search(r"With the stated errors the interval of K is ([\d.]+) times as wide", said.out)
    assert wider
    assert "the gain of T (thermometer)" in said.out
    assert "times noise" in said.out
    assert "Uncertainty with stated errors" in (folder / "heater.html").read_text()

    record = json.loads(call(capsys, monkeypatch, "report", "--json").out)
    rows = {p["name"]: p for p in record["parameters"]}
    ratio = rows["K"]["uncertainty"]["combined"] / rows["K"]["standard_error"]
    assert float(wider[1]) == pytest.approx(ratio, rel=0.05)
    gain = rows["K"]["uncertainty"]["sources"]["thermometer"]
    assert gain == pytest.approx(rows["K"]["value"] * 0.01 / np.sqrt(3), rel=1e-3)  # a gain of T scales K as it is
    zero = rows["T0"]["uncertainty"]["sources"]["cold junction"]
    assert zero == pytest.approx(0.1 / np.sqrt(3), rel=1e-2)

    study = pf.load("heater.toml")
    answer = pf.fit(study.problem, errors=study.errors, seed=3)
    found = propagate(answer.problem, answer, study.errors)
    for name, combined in zip(found.names, found.combined, strict=True):
        assert rows[name]["uncertainty"]["combined"] == pytest.approx(combined, rel=1e-3)

    assert call(capsys, monkeypatch, "export", "--json").code == 0
    said = call(capsys, monkeypatch, "import", "heater.json", "--spec", "heater.toml", "--store", "new.db")
    assert said.code == 0, said.err
    again = json.loads(call(capsys, monkeypatch, "report", "--json", "--store", "new.db", "--out", "again.html").out)
    assert again["uncertainty"] == record["uncertainty"]
    assert again["parameters"] == record["parameters"]
    assert "[uncertainty.thermometer]" in again["reproduction"]["spec"]
    assert call(capsys, monkeypatch, "compare", "--out", "compare.html").code == 0


@pytest.mark.thorough
def test_draws_of_the_study_file_reach_the_report(folder, capsys, monkeypatch):
    place = folder / "heater.toml"
    place.write_text(place.read_text() + "[propagation]\ndraws = 20\n")
    record = json.loads(call(capsys, monkeypatch, "run", "heater.toml", "--json").out)
    assert record["uncertainty"]["method"] == "monte carlo"
    assert record["uncertainty"]["draws"] == 20
    assert "by 20 draws of errors" in (folder / "heater.html").read_text()
