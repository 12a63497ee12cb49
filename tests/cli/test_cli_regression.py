"""A study with a table [regression] by `plantfit check` and `plantfit run`: against the truth of virtual rigs, over
seeds."""

import json

import numpy as np
import pytest
from cli_call import call

OFF = 'method = "least squares"'


def recorded(capsys, monkeypatch, folder, seed, *more):
    words = (
        "rig",
        "pendubot",
        "--set",
        "l1=0.25",
        "--seed",
        seed,
        "--study",
        "--force",
        "--out",
        folder / "run.csv",
        *more,
    )
    assert call(capsys, monkeypatch, *words).code == 0
    return {n: d["value"] for n, d in json.loads((folder / "run.truth.json").read_text("utf-8"))["determined"].items()}


def rows(said):
    assert said.code == 0, said.err
    return {p["name"]: p for p in json.loads(said.out)["parameters"]}


@pytest.mark.parametrize("count", [8, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_intervals_hold_the_truth_and_those_of_plain_least_squares_do_not(capsys, monkeypatch, tmp_path, count):
    monkeypatch.chdir(tmp_path)
    held, plain, errors, first = [], [], [], 40_000
    for seed in range(first, first + count):
        truth = recorded(capsys, monkeypatch, tmp_path, seed)
        said = call(capsys, monkeypatch, "run", "run.toml", "--json")
        found = rows(said)
        assert json.loads(said.out)["durbin_wu_hausman"]["p_value"] < 1e-10
        inside = [[found[n][k]["low"] <= v <= found[n][k]["high"] for n, v in truth.items()] for k in KINDS]
        held.append(inside[0])
        plain.append(inside[1])
        errors.append(found["b5"]["instrumental_variables"]["standard_error"] / truth["b5"])
    assert np.median(errors) < 0.025  # and they are not merely wide
    assert max(errors) < 0.05
    # 32 correlated intervals of 95 %: fewer than 25 come once in 7000 times, were each record's four independent
    assert np.sum(held) >= (25 if count == 8 else 0)
    if count > 100:
        assert np.all(np.abs(np.mean(held, axis=0) - 0.95) <= 0.04), np.mean(held, axis=0)
    assert not np.any(np.all(plain, axis=1))
    assert np.mean(plain) < 0.2


KINDS = ("instrumental_variables", "least_squares")


def test_run_shows_both_estimates_and_the_test_of_their_difference(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    recorded(capsys, monkeypatch, tmp_path, 3)
    said = call(capsys, monkeypatch, "run", "run.toml")
    assert said.code == 0, said.err
    assert "instrumental variables" in said.out
    assert "least squares" in said.out
    assert "Plain least squares differs from instrumental variables by more than chance" in said.out
    page = (tmp_path / "run.html").read_text("utf-8")
    assert "Use the instrumental variables" in page
    assert "tau1" in page
    assert not (tmp_path / "plantfit.db").exists()


def test_least_squares_alone_is_warned_of_by_check_and_by_run(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    recorded(capsys, monkeypatch, tmp_path, 3)
    study = tmp_path / "run.toml"
    text = study.read_text("utf-8").replace('method = "instrumental variables"', OFF)
    study.write_text("".join(line for line in text.splitlines(True) if not line.startswith("reference")), "utf-8")
    for command in ("check", "run"):
        said = call(capsys, monkeypatch, command, "run.toml")
        assert said.code == 0, said.err
        assert "whose errors stand in the columns" in said.out or "derivatives of measured signals" in said.out
        assert "fit it by instrumental variables" in said.out
    found = rows(call(capsys, monkeypatch, "run", "run.toml", "--json"))
    assert found["b1"]["instrumental_variables"] is None


def test_a_regression_of_columns_made_by_cleaning_steps_is_warned_of(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    t = np.arange(2000) * 0.005
    x = 0.1 * np.sin(3 * t) + 0.05 * np.sin(7 * t)
    v, a = 0.3 * np.cos(3 * t) + 0.35 * np.cos(7 * t), -0.9 * np.sin(3 * t) - 2.45 * np.sin(7 * t)
    force = 80 * a + 150 * v + 30 * np.sign(v)
    np.savetxt(
        "run.csv", np.stack([t, x, force, v, a], axis=1), delimiter=",", header="t,position,force,v,a", comments=""
    )
    step = (
        'clean = [{ step = "smooth_motion", signal = "position", velocity = "velocity", acceleration = '
        '"acceleration", cutoff = 20.0 }]\n'
    )
    model = '[model]\nkind = "drive_regression"\nfilter_alike = { cutoff = 5.0, every = 5 }\n'
    (tmp_path / "s.toml").write_text(f'name = "s"\n[recording.r]\nfile = "run.csv"\n{step}{model}', "utf-8")
    said = call(capsys, monkeypatch, "check", "s.toml")
    assert said.code == 0, said.err
    assert "fit it by instrumental variables" in said.out
    assert "velocity" in said.out
    # columns that sensors measured, and none that is an acceleration, ask for nothing
    (tmp_path / "e.toml").write_text(
        'name = "e"\n[recording.r]\nfile = "run.csv"\n[model]\nequations = "force = k*position + d*v"\ninputs = '
        '["position", "v"]\n'
        'outputs = ["force"]\n[parameters.k]\nbounds = [0, 1e3]\n[parameters.d]\nbounds = [0, 1e3]\n', "utf-8",
    )  # fmt: skip
    said = call(capsys, monkeypatch, "check", "e.toml")
    assert said.code == 0, said.err
    assert "instrumental" not in said.out


def test_other_commands_do_not_search_what_needs_instruments(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    recorded(capsys, monkeypatch, tmp_path, 3)
    said = call(capsys, monkeypatch, "compare-records", "run.toml")
    assert said.code == 8
    assert "solve it by `plantfit run run.toml`" in said.err
    for words in (("tune-search", "run.toml", "--method", "pso"), ("diagnose", "run.toml")):
        said = call(capsys, monkeypatch, *words)
        assert said.code != 0
        assert said.err.count("\n") == 1


DRIVE = """name = "drive"
[recording.r]
file = "drive.csv"
time = "t [s]"
signals = {{ position = "position [m]", force = "force [{force}]", wanted = "wanted [{wanted}]" }}
[model]
kind = "drive_regression"
[regression]
method = "instrumental variables"
reference = {{ position = "wanted" }}
derivatives = {{ position = ["velocity", "acceleration"] }}
smoothing = 20.0
band = 5.0
"""


@pytest.mark.parametrize(("force", "wanted"), [("N", "m"), ("kN", "m"), ("N", "mm"), ("V", "m"), ("N", "V")])
def test_targets_and_references_are_converted_or_refused(capsys, monkeypatch, tmp_path, force, wanted):
    """A force in kN was taken for one in N, and a voltage too."""
    monkeypatch.chdir(tmp_path)
    t, rng = np.arange(4000) * 0.005, np.random.default_rng(1)
    x, v = 0.1 * np.sin(3 * t) + 0.05 * np.sin(7 * t), 0.3 * np.cos(3 * t) + 0.35 * np.cos(7 * t)
    newton = (
        80 * (-0.9 * np.sin(3 * t) - 2.45 * np.sin(7 * t)) + 150 * v + 30 * np.sign(v) + 2 + rng.normal(0, 2, len(t))
    )
    shown = newton * {"kN": 1e-3}.get(force, 1.0)
    columns = [t, x + 1e-5 * rng.normal(size=len(t)), shown, x * {"mm": 1e3}.get(wanted, 1.0)]
    header = f"t [s],position [m],force [{force}],wanted [{wanted}]"
    np.savetxt("drive.csv", np.stack(columns, axis=1), delimiter=",", header=header, comments="")
    (tmp_path / "drive.toml").write_text(DRIVE.format(force=force, wanted=wanted), "utf-8")
    said = call(capsys, monkeypatch, "run", "drive.toml", "--json")
    if "V" in (force, wanted):
        name, unit = ("force", "N") if force == "V" else ("wanted", "m")
        assert said.code == 4
        assert (
            f"signal '{name}' is in 'V', which cannot be converted to the model's '{unit}'; correct one of them."
            in said.err
        )
        return
    found = rows(said)
    for name, true in (("M", 80.0), ("Fv", 150.0), ("Fc", 30.0)):
        assert found[name]["instrumental_variables"]["value"] == pytest.approx(true, rel=0.05)


PLAIN = """\
name = "arm"
[recording.run]
file = "arm.csv"
clean = [{ step = "differentiate", signal = "q", name = "v", method = "central" }]
[model]
equations = "tau = B*v + c"
inputs = { v = "rad/s" }
outputs = { tau = "N*m" }
[parameters.B]
bounds = [0.0, 1.0]
unit = "N*m*s/rad"
[parameters.c]
bounds = [-1.0, 1.0]
unit = "N*m"
"""


@pytest.mark.parametrize("derived", [True, False])
def test_the_verdict_says_which_columns_are_derivatives(capsys, monkeypatch, tmp_path, derived):
    monkeypatch.chdir(tmp_path)
    t = np.arange(400) * 0.01
    noise = np.random.default_rng(3).normal(0.0, 3e-3, (2, len(t)))
    angle, rate = np.sin(2.0 * t) + noise[0], 2.0 * np.cos(2.0 * t)
    rows = np.c_[t, angle, rate, 0.2 * rate + 0.1 + noise[1]]
    np.savetxt("arm.csv", rows, delimiter=",", header="t [s],q [rad],w [rad/s],tau [N*m]", comments="")
    measured = 'signals = { v = "w [rad/s]", tau = "tau [N*m]" }\n#'
    (tmp_path / "arm.toml").write_text(PLAIN if derived else PLAIN.replace("clean", measured), "utf-8")
    found = json.loads(call(capsys, monkeypatch, "run", "arm.toml", "--json", "--no-diagnose").out)
    said = [
        v["sentence"] for v in found["verdict"] if v["sentence"].startswith("The columns of this regression hold v.")
    ]
    assert len(said) == derived
    assert found["differentiated"] == ["v"] * derived
    value = next(p["value"] for p in found["parameters"] if p["name"] == "B")
    assert (abs(value - 0.2) > 1e-3) == derived  # the errors of v, 0.2 rad/s, take 2 % of B
