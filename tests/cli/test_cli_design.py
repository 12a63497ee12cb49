"""`plantfit design`: from a finished study of a heater with known truth to an input that can be recorded, its page,
and refusals."""

import json
import shutil

import numpy as np
import pytest
from cli_call import call, heater

from plantfit.recording import read_csv

FEW = ("--budget", "100", "--draws", "2")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of the finished study; the first test that asks for `place` fills it."""
    return tmp_path_factory.mktemp("finished")


@pytest.fixture
def place(finished, tmp_path, monkeypatch, capsys):
    """A copy of its own of the finished study."""
    if not (finished / "heater.toml").exists():
        heater(finished)
        monkeypatch.chdir(finished)
        assert call(capsys, monkeypatch, "run", "heater.toml", "--no-diagnose").code == 0
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("repeated", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_an_input_within_limits_is_written_for_record_with_a_page(repeated, place, capsys, monkeypatch):
    words = (
        "design",
        "heater.toml",
        "--input",
        "u=0..100",
        "--limit",
        "T=..318.15 K",
        "--slew",
        "u=10",
        "--duration",
        "5min",
        "--for",
        "tau,L",
    )
    said = call(capsys, monkeypatch, *words, *FEW)
    assert said.code == 0, said.err
    text = " ".join(said.out.split())
    assert "With 300 s of this input the standard errors become: tau" in text
    assert "u from 0 to 100 %, at most 10 %/s." in text
    assert "Next: plantfit record --excitation heater-next.csv" in text
    played = read_csv("heater-next.csv")
    u = played["u"]
    assert len(u) == 300
    assert u.min() >= 0
    assert u.max() <= 100
    assert np.max(np.abs(np.diff(u))) <= 10 + 1e-9
    y, late = 24.0, np.repeat(u, 10)  # the plant itself, in steps of 0.1 s
    hottest = max(y := 0.8 * v + 21 + (y - 0.8 * v - 21) * np.exp(-0.1 / 40) for v in late)
    assert hottest < 45.3  # 45 degC for the fit, whose gain is known to 1 %
    page = (place / "heater-next.html").read_text()
    assert "Next experiment: heater" in page
    assert "plotly" in page

    again = call(capsys, monkeypatch, *words, *FEW)
    assert again.code != 0
    assert "heater-next.csv exists already" in again.err
    if not repeated:
        return
    record = json.loads(call(capsys, monkeypatch, *words, *FEW, "--force", "--json").out)
    assert record["chosen"] == ["tau", "L"]
    assert record["limits"]["T"]["high"] == pytest.approx(45.0)
    assert record["limits"]["T"]["reached"][1] <= 45.0
    assert np.array_equal(read_csv("heater-next.csv")["u"], u)


@pytest.mark.thorough
def test_a_second_lag_is_told_from_a_longer_dead_time(place, capsys, monkeypatch):
    text = (place / "heater.toml").read_text()
    other = (
        text.replace('"heater"', '"two lags"')
        .replace("delay(u, L)", "z")
        .replace("x' =", "z' = (delay(u, L) - z)/tau2\nx' =")
    )
    other = other.replace("states = {", 'states = { z = { unit = "%", initial = "u" },')
    other = other.replace("[search]", '[parameters.tau2]\nbounds = [0.5, 20.0]\nscale = "log"\nunit = "s"\n[search]')
    (place / "two.toml").write_text(other)
    assert call(capsys, monkeypatch, "run", "two.toml", "--no-diagnose").code == 0
    words = (
        "design",
        "heater.toml",
        "--against",
        "two.toml",
        "--input",
        "u=0..100",
        "--duration",
        "3min",
        *FEW,
        "--json",
    )
    record = call(capsys, monkeypatch, *words).record("design")
    assert record["against"] == "two lags"
    assert record["distance"] > 0
    assert "two lags foretell lie" in record["verdict"][0]["sentence"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--input", "v=0..1"), "inputs names 'v'; there are u"),
        (("--input", "u=high"), "--input"),
        (("--limit", "T=..10 degC"), "keeps the limits"),
        (("--for", "taus"), "There is no free parameter 'taus'; there are K, T0, tau, L"),
        (("--duration", "soon"), "duration"),
        (("--against", "gone.toml"), "There is no study file 'gone.toml'"),
        (("--study", "7"), "7"),
    ],
)
@pytest.mark.further(2)
def test_refusals_are_one_sentence_and_nothing_is_written(place, capsys, monkeypatch, words, said):
    found = call(capsys, monkeypatch, "design", "heater.toml", *words, *FEW)
    assert found.code not in (0, 1)
    assert said in found.err
    assert len(found.err.strip().splitlines()) <= 2
    assert not (place / "heater-next.csv").exists()
