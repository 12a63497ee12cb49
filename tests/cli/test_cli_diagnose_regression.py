"""`plantfit diagnose` of a regression: the study file that it writes, what `run` then says, and mistakes."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_call import call

sys.path.append(str(Path(__file__).resolve().parents[1] / "trust"))
from axis_records import study


@pytest.fixture
def axis(tmp_path, monkeypatch):
    """A drive with dry friction of 1.5 N, which its study holds at zero."""
    monkeypatch.chdir(tmp_path)
    study(tmp_path, 5, lambda q, v: 0.5 + 1.5 * np.sign(v), False)
    return tmp_path


def test_what_it_writes_is_run_and_has_the_truth(axis, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "diagnose", "axis.toml", "--out", "new.toml")
    assert said.code == 0, said.err
    assert "Dry friction of 1.50" in said.out
    assert "very likely missing" in said.out
    found = json.loads(call(capsys, monkeypatch, "run", "new.toml", "--json").out)
    values = {p["name"]: p["value"] for p in found["parameters"]}
    assert values["coulomb_force_with_velocity"] == pytest.approx(1.5, rel=0.01)
    assert values["M"] == pytest.approx(2.3, rel=0.01)


def test_a_file_that_is_there_is_kept_and_what_was_found_is_said(axis, capsys, monkeypatch):
    (axis / "new.toml").write_text("mine")
    said = call(capsys, monkeypatch, "diagnose", "axis.toml", "--out", "new.toml")
    assert said.code != 0
    assert "Dry friction of 1.50" in said.out
    assert "'new.toml' exists already; give another name with --out, or --force to overwrite it." in said.err
    assert (axis / "new.toml").read_text() == "mine"


def test_one_that_is_asked_for_is_written_whatever_it_explains(axis, capsys, monkeypatch):
    said = call(
        capsys, monkeypatch, "diagnose", "axis.toml", "--try", "drag by the square on force with velocity", "--json"
    )
    assert said.code == 0, said.err
    record = json.loads(said.out)
    assert record["write"][1].startswith('quadratic = { "force with velocity" = [')
    assert Path(record["file"]).exists()
    wrong = call(capsys, monkeypatch, "diagnose", "axis.toml", "--try", "dead time of force")
    assert wrong.code != 0
    assert "There is no 'dead time of force' to try." in wrong.err


def test_cleaning_steps_that_it_prints_are_toml():
    from tomllib import loads

    from plantfit.recording.clean.outliers import inline

    steps = [
        {"step": "drop_outliers", "signal": "y", "window": 11, "threshold": 6.0},
        {"step": "cut", "start": 0.5},
        {"step": "drop_samples", "signal": "Füllstand", "times": [0.5, 1.25]},
    ]
    assert loads(f"clean = [{', '.join(map(inline, steps))}]") == {"clean": steps}


@pytest.mark.parametrize("filtered", [False, True])
def test_run_names_what_a_regression_lacks(tmp_path, capsys, monkeypatch, filtered):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, 5, lambda q, v: 0.5 + 1.5 * np.sign(v), filtered)
    said = call(capsys, monkeypatch, "run", "axis.toml")
    assert said.code == 0, said.err
    assert "Dry friction of 1.50" in said.out
    assert 'Next: plantfit run axis.toml --try "dry friction on force with velocity over 0.0001"' in " ".join(
        said.out.split()
    )


def test_run_says_nothing_of_a_regression_that_lacks_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study(tmp_path, 6, lambda q, v: 0.5 + 0.0 * v, False)
    said = call(capsys, monkeypatch, "run", "axis.toml")
    assert said.code == 0, said.err
    assert "missing" not in said.out
