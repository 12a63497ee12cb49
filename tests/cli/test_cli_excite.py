"""`plantfit excite`: files that it writes, limits, and mistakes."""

import json

import numpy as np
import pytest
from cli_call import call

from plantfit.recording import read_csv
from plantfit.recording.excitation import prbs


def test_a_prbs_with_everything(capsys, monkeypatch, tmp_path):
    places = [tmp_path / name for name in ("excite.csv", "excite.h", "excite.html")]
    said = call(
        capsys, monkeypatch, "excite", "prbs", "--amplitude", "6V", "--rate", "100Hz", "--duration", "0.5min", "--hold",
        "3", "--seed", "4",
        "--voltage", "3000mV", "--out", places[0], "--header", places[1], "--preview", places[2],
    )  # fmt: skip
    assert said.code == 0, said.err
    np.testing.assert_array_equal(read_csv(places[0])["V"], prbs(3.0, 100, 30, hold=3, seed=4)["V"])
    assert "scaled by 0.5" in said.out
    assert "int16_t excite[EXCITE_LENGTH]" in places[1].read_text()
    page = places[2].read_text()
    assert "PRBS of order 10" in page
    assert "frequency [Hz]" in page


@pytest.mark.parametrize("kind", ["multisine", "chirp", "staircase", "sine-square"])
def test_every_kind_has_defaults(capsys, monkeypatch, tmp_path, kind):
    length = ("--period", "10s") if kind == "multisine" else ("--duration", "40s")
    said = call(capsys, monkeypatch, "excite", kind, "--amplitude", "5", *length, "--out", tmp_path / "e.csv", "--json")
    told = json.loads(said.out)
    made = read_csv(tmp_path / "e.csv")
    assert told["samples"] == len(made)
    assert np.max(np.abs(made["V"])) == pytest.approx(5.0, rel=1e-3)
    assert told["crest_factor"] == pytest.approx(np.max(np.abs(made["V"])) / np.sqrt(np.mean(made["V"] ** 2)))


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("noise", "--amplitude", "6V"), 7, "there are prbs, multisine"),
        (
            ("chirp", "--amplitude", "6V", "--duration", "10s", "--order", "4"),
            7,
            "--order cannot be used with chirp; it takes --rate, --duration",
        ),
        (("chirp", "--amplitude", "6V"), 7, "needs --duration"),
        (("prbs", "--amplitude", "six"), 7, "--amplitude 'six' is not a number"),
        (("prbs", "--amplitude", "6kg", "--duration", "10s"), 4, "'6kg' is in 'kg', but the signal 'V' is a voltage"),
        (("prbs", "--amplitude", "6blah", "--signal", "u", "--duration", "10s"), 4, "blah"),
        (("prbs", "--amplitude", "6V", "--duration", "10m"), 4, "cannot be converted"),
        (("prbs", "--amplitude", "6V", "--duration", "10s", "--slew", "10V/s"), 3, "slew of 10"),
        (("prbs", "--amplitude", "6V", "--duration", "10s", "--duty", "0.9"), 3, "supply="),
        (("prbs", "--amplitude", "6V", "--duration", "10s", "--out", "nowhere/e.csv"), 3, "cannot be written"),
    ],
)
def test_mistakes_are_one_sentence(capsys, monkeypatch, tmp_path, words, code, sentence):
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "excite", *words)
    assert said.code == code
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_another_signal_may_be_in_another_unit(capsys, monkeypatch, tmp_path):
    out = ("--duration", "10s", "--out", tmp_path / "e.csv")
    assert call(capsys, monkeypatch, "excite", "prbs", "--amplitude", "2N*m", "--signal", "torque", *out).code == 0
    made = read_csv(tmp_path / "e.csv")
    assert np.max(made["torque"]) == 2.0
    assert made.signals["torque"].unit == "N*m"


def test_steps_and_dead_zones_in_another_unit_of_temperature_are_sizes(capsys, monkeypatch, tmp_path):
    def made(step):
        place = tmp_path / f"{step}.h"
        said = call(
            capsys, monkeypatch, "excite", "prbs", "--amplitude", "5degC", "--signal", "T", "--rate", "1Hz",
            "--duration", "60s",
            "--step", step, "--out", tmp_path / f"{step}.csv", "--header", place,
        )  # fmt: skip
        assert said.code == 0, said.err
        return [line.split()[-1] for line in place.read_text().splitlines() if "STEP" in line and "define" in line]

    assert made("1.8degF") == made("1degC") == made("1K")
