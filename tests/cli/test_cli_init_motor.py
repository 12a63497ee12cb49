"""`plantfit init --model dc_motor`: what it writes with and without a current, what it says of further measurements,
and mistakes."""

import json

import numpy as np
import pytest
from cli_call import call

import plantfit as pf
from plantfit.models.library.speed_law import speed_law
from plantfit.recording import from_arrays, to_csv
from plantfit.rig.offered import record_rig

CONSTANTS = ("Rm", "Lm", "Kb", "Jm", "Cm", "Tf")
TRUE = {"Rm": 2.826, "Lm": 0.0452, "Kb": 0.0926, "Jm": 0.0023, "Cm": 0.0023, "Tf": 5e-3}


def motor(folder, *without, **changes):
    made = record_rig("dc_motor", {"Tf": TRUE["Tf"], **changes}, seed=4, without=without, duration=90.0)
    made.save(folder / "motor.csv")
    return {n: d["value"] for n, d in made.truth["determined"].items()}


@pytest.mark.thorough
def test_without_a_current_the_determined_combinations_are_found(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    truth = motor(tmp_path, "i")
    said = call(capsys, monkeypatch, "init", "motor.csv", "--model", "dc_motor")
    assert said.code == 0, said.err
    for told in (
        "c0 = (Rm Cm + Kt Kb)/Kt",
        "f = Rm Tf/Kt",
        "the current",
        "Rm (ohmmeter) and Kb",
        "Rm alone",
        "Lm alone",
    ):
        assert told in said.out
        assert told in (tmp_path / "motor.toml").read_text("utf-8")
    run = call(capsys, monkeypatch, "run", "motor.toml", "--no-diagnose", "--json")
    assert run.code == 0, run.err
    rows = {p["name"]: p for p in json.loads(run.out)["parameters"]}
    assert set(rows) == {"c0", "c1", "c2", "f"}  # at rest at the start: nothing more is free
    for name, row in rows.items():
        assert abs(row["value"] - truth[name]) < 4 * row["standard_error"]
        assert row["lower_bound"] < truth[name] < row["upper_bound"]
    assert all(rows[n]["status"] == "determined" for n in ("c0", "c1", "c2"))


def test_with_a_current_every_constant_is_free(capsys, monkeypatch, tmp_path):
    motor(tmp_path)
    said = call(capsys, monkeypatch, "init", tmp_path / "motor.csv", "--model", "dc_motor", "--json")
    told = json.loads(said.out)
    assert told["columns"] == {"V": "V [V]", "w": "w [rad/s]", "i": "i [A]"}
    study = pf.load(told["file"])
    assert set(study.problem.space.names) == set(CONSTANTS)
    assert set(study.problem.model.outputs) == {"w", "i"}


def test_a_motor_that_turns_at_the_start_in_rpm_under_a_voltage_without_unit(capsys, monkeypatch, tmp_path):
    t = np.arange(400) * 0.01
    volts = 6 + 3 * np.sign(np.sin(2 * t))
    speed = 60 / (2 * np.pi) * (100 + 20 * np.sin(2 * t))
    to_csv(from_arrays(t, signals={"voltage": (volts, None), "n": (speed, "rpm")}, name="m"), tmp_path / "m.csv")
    said = call(capsys, monkeypatch, "init", tmp_path / "m.csv", "--model", "dc_motor")
    assert said.code == 0, said.err
    study = pf.load(tmp_path / "m.toml")
    assert {"w_start", "a_start"} < set(study.problem.space.names)
    bounds = {c.name: (c.lower, c.upper) for c in study.problem.space.coordinates}
    assert bounds["w_start"][0] < 100 < bounds["w_start"][1]
    assert "the file gives none: correct them" in study.text


@pytest.mark.parametrize(
    ("measured", "short"),
    [((), 2), (("Rm",), 1), (("Lm",), 1), (("Kb",), 1), (("Rm", "Lm"), 0), (("Rm", "Kb"), 0)],
)
def test_what_it_says_of_further_measurements_is_the_rank_of_the_combinations(measured, short):
    free = [n for n in CONSTANTS if n not in measured]
    columns = []
    for name in free:
        up, down = ({**TRUE, name: TRUE[name] * (1 + s * 1e-6)} for s in (1, -1))
        columns.append((np.log(speed_law(up)) - np.log(speed_law(down))) / 2e-6)
    rank = np.linalg.matrix_rank(np.stack(columns, axis=1), tol=1e-6)
    assert len(free) - rank == short


def test_rm_and_kb_give_the_rest_by_the_formulas_that_it_says():
    c0, c1, c2, f = speed_law(TRUE)
    rm, kb = TRUE["Rm"], TRUE["Kb"]
    cm = (c0 - kb) * kb / rm
    assert cm == pytest.approx(TRUE["Cm"], rel=1e-12)
    assert f * kb / rm == pytest.approx(TRUE["Tf"], rel=1e-12)
    # Rm Jm + Lm Cm = c1 Kb and Lm Jm = c2 Kb
    roots = np.roots([rm, -c1 * kb, c2 * kb * cm])
    assert np.min(np.abs(roots - TRUE["Jm"])) < 1e-12


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("--model", "pendubot"), 7, "--model 'pendubot': init writes a study of the model dc_motor only"),
        (("--model", "dc_motor", "--candidates"), 7, "cannot be used with --model; leave one of the two out"),
        (
            ("--model", "dc_motor"),
            3,
            "no column is a motor's voltage in V (a duty is turned into it by the step duty_to_voltage)",
        ),
    ],
)
def test_mistakes(capsys, monkeypatch, tmp_path, words, code, sentence):
    record_rig("robot_motor", duration=0.05).save(tmp_path / "raw.csv")
    said = call(capsys, monkeypatch, "init", tmp_path / "raw.csv", *words)
    assert said.code == code
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "raw.toml").exists()
