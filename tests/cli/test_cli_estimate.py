"""`plantfit estimate` and `plantfit track` on a plant with process noise whose truth is known."""

import io
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_call import call

sys.path.insert(0, str(Path(__file__).parents[1] / "estimate"))

import wandering_plants as lag

import plantfit.recording as rec

WHOLE = (
    lag.STUDY
    + """
[estimate]
methods = ["maximum likelihood", "ekf", "kalman"]
[estimate.process]
x = [0.01, "5 K/s^0.5"]
[estimate.measurement]
y = "50 mK"
[estimate.truth]
K = 2.0
"""
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    lag.save(lag.record(41, 400), folder / "bench.csv")
    (folder / "lag.toml").write_text(WHOLE)
    lag.save(lag.record(42, 800), folder / "healthy.csv")
    lag.save(lag.record(43, 1600, lag.TRUTH | {"K": 2.8}, after=400), folder / "worn.csv")
    return folder


def test_the_truth_that_a_rig_leaves_is_read_in_the_units_of_the_study(bench, monkeypatch):
    """Of a problem whose search is not run: only names, units and files count."""
    from types import SimpleNamespace

    from plantfit.estimators import known_truth
    from plantfit.spec.reading import load

    study = load(bench / "lag.toml")
    answer: Any = SimpleNamespace(problem=study.problem, spec=study.text)
    assert known_truth(answer) == {}
    (bench / "bench.truth.json").write_text(
        '{"rig": "lag", "constants": {"tau": {"value": 500, "unit": "ms"}, "K": {"value": 2, "unit": "s"}, "other": '
        '1}, "determined": []}'
    )
    assert known_truth(answer) == {"tau": 0.5}
    (bench / "bench.truth.json").write_text("not JSON")
    assert known_truth(answer) == {}
    (bench / "bench.truth.json").unlink()


@pytest.mark.thorough
def test_estimates_of_a_study_file(bench, capsys, monkeypatch):
    monkeypatch.chdir(bench)
    said = call(capsys, monkeypatch, "estimate", "lag.toml", "--json", "--out", "page.html")
    assert said.code == 0, said.err
    record = said.record("estimate")
    assert record["methods"] == ["least squares", "maximum likelihood", "EKF"]
    assert [f["method"] for f in record["filters"]] == ["EKF", "Kalman filter"]
    assert record["agree"] is True
    assert [p["truth"] for p in record["parameters"]] == [2.0, None]
    gain = record["parameters"][0]["estimates"]
    assert all(e["low"] < 2.1 and e["high"] > 1.9 for e in gain.values())
    assert [r["how"] for r in record["noise"]] == ["found", "given"]
    assert record["noise"][1]["value"] == pytest.approx(0.05)
    assert "How the constants settle" in (bench / "page.html").read_text("utf-8")


@pytest.mark.thorough
def test_states_are_written_filtered_and_smoothed(bench, capsys, monkeypatch):
    """Against the plant's true state: bands of two standard deviations hold it, and what comes later makes it better
    known."""
    monkeypatch.chdir(bench)
    said = call(capsys, monkeypatch, "estimate", "lag.toml", "--method", "ekf", "--states", "states.csv")
    assert said.code == 0, said.err
    assert "States: states.csv" in said.out
    states, truth = rec.read_csv("states.csv"), lag.record(41, 400, measurement=0.0)["y"]
    assert states.signals["x_smoothed"].unit == "K"
    wrong = {}
    for kind in ("filtered", "smoothed"):
        off, error = states[f"x_{kind}"] - truth, states[f"x_{kind}_error"]
        assert 0.9 < np.mean(np.abs(off) < 2 * error) <= 1.0
        wrong[kind] = np.sqrt(np.mean(off**2))
    assert wrong["smoothed"] < 0.9 * wrong["filtered"] < 0.9 * 0.05  # sensor noise of 0.05 K
    assert np.all(states["x_smoothed_error"] <= states["x_filtered_error"] * (1 + 1e-9))
    again = call(capsys, monkeypatch, "estimate", "lag.toml", "--method", "ekf", "--states", "states.csv")
    assert again.code == 0
    assert "study 1 has its answer" in again.err
    assert "K [K/V]" in again.out
    assert "EKF: The innovations are" in again.out
    assert "initial x:" in again.out  # what was assumed


@pytest.mark.parametrize(
    ("method", "file", "code", "sentence"),
    [
        ("maximum likelihood", "other.csv", 7, "no filter is among the methods"),
        ("ekf", "bench.csv", 10, "holds no states"),
        ("ekf", "binary.csv", 10, "holds no states"),
        ("ekf", "binary.csv.gz", 10, "holds no states"),
        ("ekf", "none/states.csv", 10, "there is no folder none"),
        ("ekf", ".", 10, "holds no states"),
    ],
)
def test_states_that_cannot_be_are_refused_before_anything_is_computed(
    bench, capsys, monkeypatch, method, file, code, sentence
):
    monkeypatch.chdir(bench)
    monkeypatch.setattr("plantfit.estimators.estimate_parameters", None)
    (bench / "binary.csv").write_bytes(b"\xff\xfe\x00data")
    (bench / "binary.csv.gz").write_bytes(b"\x1f\x8bdata")
    before = {f.name: f.read_bytes() for f in bench.iterdir() if f.is_file() and f.suffix in (".csv", ".gz")}
    said = call(
        capsys, monkeypatch, "estimate", "lag.toml", "--method", method, "--states", file, "--store", "unused.db"
    )
    assert said.code == code
    assert sentence in said.err.replace("\n", " ")
    assert {f.name: f.read_bytes() for f in bench.iterdir() if f.is_file() and f.suffix in (".csv", ".gz")} == before


@pytest.mark.thorough
def test_new_measurements_are_tracked(bench, capsys, monkeypatch):
    monkeypatch.chdir(bench)
    quiet = call(capsys, monkeypatch, "track", "lag.toml", "--recording", "healthy.csv", "--out", "rows.csv")
    assert quiet.code == 0, quiet.err
    assert "No alarm: the plant is what the study knows of it (800 samples" in quiet.out
    rows = np.genfromtxt(bench / "rows.csv", delimiter=",", names=True, deletechars="")
    assert (rows.dtype.names or ())[:4] == ("t_[s]", "x_[K]", "x_sd_[K]", "K_[K/V]")
    assert np.all(rows["alarm"] == 0)
    assert call(capsys, monkeypatch, "track", "lag.toml", "-r", "healthy.csv", "--out", "rows.csv").code == 10

    worn = call(capsys, monkeypatch, "track", "lag.toml", "--recording", "worn.csv", "--every", "1s")
    assert worn.code == 0
    assert "ALARM at" in worn.err
    assert "K has left what the study knows" in worn.err
    lines = worn.out.strip().splitlines()
    assert lines[0].startswith("t [s],x [K],x_sd [K],K [K/V],K_sd [K/V]")
    assert len(lines) == 1 + 80
    assert float(lines[-1].split(",")[3]) == pytest.approx(2.8, rel=0.1)


@pytest.mark.thorough
def test_standard_input_is_tracked(bench, capsys, monkeypatch):
    monkeypatch.chdir(bench)
    read, write = os.pipe()
    os.write(write, (bench / "worn.csv").read_bytes()[:60000])  # a pipe takes 64 KiB
    os.close(write)

    class Standard(io.StringIO):
        def fileno(self):
            return read

    monkeypatch.setattr(sys, "stdin", Standard())
    said = call(capsys, monkeypatch, "track", "lag", "--recording", "-", "--json")
    os.close(read)
    assert said.code == 0, said.err
    told = said.record("track")
    assert told["samples"] > 500
    assert told["alarms"][0]["parameter"] == "K"
    assert told["alarms"][0]["t"] > 20.0
    assert told["looks"] >= 1


@pytest.mark.parametrize("levels", ["", ", backward = 1", ", forward = 1, backward = 2"])
def test_a_duty_with_its_direction_is_followed_also_while_it_runs_one_way(tmp_path, levels):
    """The study's own recording says the levels of a direction that rows to come may not show."""
    from plantfit.cli.commands.bench.track import _reader, _source
    from plantfit.spec.reading import load

    recording = lag.record(41, 400)
    t, duty, y = recording.t, recording["u"], recording["y"]
    way = np.where(np.arange(400) < 250, 1, 2)
    rows = [f"{a},{b},{c},{d}\n" for a, b, c, d in zip(t, duty, way, y, strict=True)]
    (tmp_path / "bench.csv").write_text("".join(["t,duty,dir,y\n", *rows]))
    step = f'clean = [{{ step = "signed", signal = "duty", direction = "dir", name = "u"{levels} }}]'
    (tmp_path / "lag.toml").write_text(WHOLE.replace('time = "t"', f'time = "t"\n{step}', 1))
    read = _reader(load(tmp_path / "lag.toml"), None, True)
    (tmp_path / "new.csv").write_text("".join(["t,duty,dir,y\n", *rows[:200]]))
    parts = list(_source(str(tmp_path / "new.csv"), read, True, 0.1, lambda: False))
    sign = 1.0 if "forward" in levels else -1.0
    np.testing.assert_allclose(np.concatenate([p["u"] for p in parts]), sign * duty[:200])


@pytest.mark.parametrize(
    ("change", "words", "code", "sentence"),
    [
        (
            ("[estimate]", "[estimate]\nmetods = 1"),
            ["estimate"],
            7,
            "key 'estimate.metods' is not known; did you mean 'methods'?",
        ),
        (
            ("[estimate.process]\nx", "[estimate.process]\nv"),
            ["estimate"],
            7,
            "[estimate.process] names 'v', which is no state",
        ),
        (('y = "50 mK"', "y = -1"), ["estimate"], 6, "[estimate]: The measurement level of 'y' is -1.0"),
        (('y = "50 mK"', 'y = "50 mV"'), ["estimate"], 4, "[estimate.measurement] y = '50 mV'"),
        (
            ("K*u - x", "K*u - delay(x, 0.1)"),
            ["track", "--recording", "healthy.csv"],
            5,
            "backlash or late states; filter a smooth form of it",
        ),
        (("", ""), ["track", "--recording", "none.csv"], 3, "There is no recording 'none.csv'"),
        (("", ""), ["track", "--recording", "healthy.csv", "--idle", "3s"], 3, "--idle is for a recording that grows"),
        (
            ("", ""),
            ["track", "--recording", "healthy.csv", "--like", "x"],
            7,
            "--like x: the study has no such recording; it has bench",
        ),
        (
            ('time = "t"', 'time = "t"\nclean = [{ step = "lowpass", signal = "y", cutoff = 3.0 }]'),
            ["track", "--recording", "healthy.csv", "--follow"],
            7,
            "'lowpass', which looks at neighbouring rows",
        ),
    ],
)
def test_a_users_slip_is_told_in_one_sentence(bench, capsys, monkeypatch, change, words, code, sentence):
    monkeypatch.chdir(bench)
    old, new = change
    (bench / "slip.toml").write_text(WHOLE.replace(old, new, 1) if old else WHOLE)
    said = call(capsys, monkeypatch, words[0], "slip.toml", *words[1:], "--store", "slip.db")
    assert said.code == code, said.err
    assert sentence in said.err
    assert "Traceback" not in said.err
    assert "inside" not in said.err
