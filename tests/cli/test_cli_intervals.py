"""`plantfit intervals`: intervals of a heater with known truth, the page, the draws, and refusals before anything is
fitted."""

import sys

import h5netcdf
import pytest
from cli_call import call, heater

TRUTH = {"K": 0.8, "T0": 21.0, "tau": 40.0, "L": 3.4}


@pytest.fixture
def place(tmp_path, monkeypatch):
    heater(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.thorough
def test_four_kinds_hold_the_truth_and_agree(place, capsys, monkeypatch):
    words = ("intervals", "heater.toml", "--posterior", "--save-draws", "draws.nc", "--draws", "100", "--only", "tau,L")
    said = call(capsys, monkeypatch, *words)
    assert said.code == 0, said.err
    assert "4 chains of 100 draws" in said.out
    page = (place / "heater-intervals.html").read_text()
    assert "Profile and draws of tau" in page
    with h5netcdf.File("draws.nc", "r") as file:
        assert file["posterior"]["tau"].attrs["units"] == "s"
        assert file["posterior"]["tau"].shape == (4, 100)
        assert file["sample_stats"]["diverging"].shape == (4, 100)

    words = ("intervals", "heater.toml", "--only", "tau,L", "--json")
    record = call(capsys, monkeypatch, *words).record("intervals")
    assert [p["name"] for p in record["parameters"]] == ["tau", "L"]
    for p in record["parameters"]:
        assert [k["kind"] for k in p["kinds"]] == ["verdict", "covariance", "profile", "bootstrap"]
        for k in p["kinds"]:  # a little wider: 95 % each
            half = 0.5 * (k["high"] - k["low"])
            assert k["low"] - half < TRUTH[p["name"]] < k["high"] + half, k
    again = call(capsys, monkeypatch, "intervals", "heater.toml", "--posterior", "--save-draws", "draws.nc")
    assert "draws.nc is there already" in again.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--kinds", "mcmc"), "There is no kind 'mcmc' of interval"),
        (("--only", "taus"), "There is no free parameter 'taus'"),
        (("--level", "high"), "--level 'high' is not a share"),
        (("--prior", "tau"), "--prior 'tau' cannot be read"),
        (("--prior", "tau=3"), "write mean and standard deviation"),
        (("--prior", "tau=3 m +- 1 m"), "The prior of tau"),
        (("--draws", "3"), "draws is 3; give 100"),
    ],
)
def test_refusals_come_before_the_fit(place, capsys, monkeypatch, words, said):
    found = call(capsys, monkeypatch, "intervals", "heater.toml", *words)
    assert found.code not in (0, 1)
    assert said in found.err
    assert "evaluations" not in found.out
    assert not (place / "heater-intervals.html").exists()


def test_a_posterior_without_blackjax_says_what_to_install(place, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    found = call(capsys, monkeypatch, "intervals", "heater.toml", "--posterior")
    assert (
        found.err
        == "plantfit: A posterior needs the package blackjax; install it with: pip install 'plantfit[posterior]'\n"
    )
