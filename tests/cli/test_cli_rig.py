"""`plantfit rig`: the list, a record with its truth and a study, and mistakes."""

import json

import pytest
from cli_call import call

from plantfit.recording import read_csv
from plantfit.rig.offered import names


def test_rigs_are_listed_with_what_they_take(capsys, monkeypatch):
    said = call(capsys, monkeypatch, "rig")
    assert said.code == 0
    assert all(name in said.out for name in names())
    one = call(capsys, monkeypatch, "rig", "dc_motor", "--list")
    assert "winding resistance" in one.out
    assert "--without: i" in one.out
    told = json.loads(call(capsys, monkeypatch, "rig", "--json").out)
    assert [r["name"] for r in told] == list(names())
    assert {k: told[1]["numbers"][6][k] for k in ("name", "unit", "value")} == {
        "name": "l1",
        "unit": "m",
        "value": 0.15,
    }


def test_a_record_with_constants_of_ones_own_its_truth_and_a_study_that_is_ready(capsys, monkeypatch, tmp_path):
    words = ("rig", "pendubot", "--set", "l1=25cm", "--set", "m2=0.1", "--seed", "3", "--study")
    said = call(capsys, monkeypatch, *words, "--out", tmp_path / "record.csv")
    assert said.code == 0, said.err
    assert "b1 = 0.009804 kg*m^2" in said.out
    assert f"plantfit check {tmp_path / 'record.toml'}" in said.out
    truth = json.loads((tmp_path / "record.truth.json").read_text("utf-8"))
    assert truth["constants"]["l1"] == {"value": 0.25, "unit": "m", "sentence": "length of link 1"}
    assert truth["record"] == "record.csv"
    first = (tmp_path / "record.csv").read_bytes()
    again = call(capsys, monkeypatch, *words, "--out", tmp_path / "record.csv", "--force", "--json")
    assert json.loads(again.out)["samples"] == 25001
    assert (tmp_path / "record.csv").read_bytes() == first  # same seed, same bits
    assert "l1 = 0.25" in (tmp_path / "record.toml").read_text("utf-8")
    checked = call(capsys, monkeypatch, "check", tmp_path / "record.toml")
    assert checked.code == 0, checked.err
    assert "99.9 % of the power of the instruments lies below" in checked.out


def test_duration_period_excitation_and_channels(capsys, monkeypatch, tmp_path):
    excite = call(
        capsys,
        monkeypatch,
        "excite",
        "prbs",
        "--amplitude",
        "6V",
        "--rate",
        "10Hz",
        "--duration",
        "12s",
        "--out",
        tmp_path / "e.csv",
    )
    assert excite.code == 0, excite.err
    made = call(
        capsys, monkeypatch, "rig", "dc_motor", "--excitation", tmp_path / "e.csv", "--period", "50ms", "--without",
        "i", "--exact",
        "--study",         "--out", tmp_path / "m.csv",
    )  # fmt: skip
    assert made.code == 0, made.err
    record = read_csv(tmp_path / "m.csv")
    assert list(record.signals) == ["V", "w"]
    assert record.t[1] == pytest.approx(0.05)
    assert "i" in read_csv(tmp_path / "m.exact.csv").signals
    assert "c1 = (Rm Jm + Lm Cm)/Kt" in (tmp_path / "m.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("pendobot",), 9, "Did you mean 'pendubot'"),
        (("pendubot", "--set", "m2=-1"), 9, "m2 = -1 kg cannot be"),
        (("pendubot", "--set", "m2=1V"), 4, "is in 'V'"),
        (("pendubot", "--set", "m2"), 6, "write NAME=VALUE"),
        (("pendubot", "--set", "q=1"), 9, "has no 'q'"),
        (("pendubot", "--set", "m2=0.1", "--set", "m2=0.2"), 9, "gives m2 twice"),
        (("pendubot", "--duration", "long"), 7, "--duration 'long' is not a number"),
        (("pendubot", "--duration", "3s", "--out", "x"), 3, "ends in .csv"),
        (("dc_motor", "--excitation", "40V"), 9, "lower it"),
    ],
)
def test_mistakes_are_told_in_one_sentence(capsys, monkeypatch, tmp_path, words, code, sentence):
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "rig", *words)
    assert said.code == code
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_tables_are_named_with_their_ranges_and_what_one_step_cannot_tell(capsys, monkeypatch, tmp_path):
    words = ("rig", "steam_chamber", "--duration", "60", "--out", tmp_path / "a.csv")
    one = call(capsys, monkeypatch, *words, "--excitation", "40%")
    told = " ".join(one.out.split())
    truth = json.loads((tmp_path / "a.truth.json").read_text("utf-8"))["determined"]
    for n in ("k", "A1", "A2"):
        low, high = min(truth[n]["value"]), max(truth[n]["value"])
        assert f"{n} = {low:.4g} to {high:.4g} {truth[n]['unit']} (table of 10)" in told
    assert "Td = " in told
    assert "One step passes each pressure once" in told
    moved = call(capsys, monkeypatch, *words, "--force", "--set", "tables_of=40%", "--excitation", "10%,25%")
    assert "One step passes" not in moved.out
