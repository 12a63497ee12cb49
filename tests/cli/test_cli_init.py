"""`plantfit init`: files of loggers to studies that run, questions in a terminal, candidates side by side."""

import json
import os
import pty
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli_call import call, exchangeable, heater

import plantfit
from plantfit import spec
from plantfit.cli.commands.begin import init

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from logger_files import STYLES, lag, prbs


@pytest.mark.parametrize("style", STYLES, ids=lambda s: s.name)
@pytest.mark.further(14)
def test_every_file_gives_a_study_that_parses(style, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    style.write(tmp_path / style.name)
    said = call(capsys, monkeypatch, "init", style.name, "--json")
    assert said.code == 0, said.err
    told = json.loads(said.out)
    problem = spec.load(tmp_path / told["file"]).problem
    headers = {c["header"]: c for c in told["columns"]}
    assert {h for h, c in headers.items() if c["role"] == "input"} == style.inputs
    assert len(told["inputs"]) == len(style.inputs)
    assert set(problem.outputs) == set(told["outputs"])
    assert len(told["outputs"]) == len(style.outputs)
    text = (tmp_path / told["file"]).read_text("utf-8")
    assert ("no time column was found" in text) == (style.time is None and style.period is None)


def test_what_is_said_names_each_column_and_the_next_command(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    next(s for s in STYLES if s.name == "idle.csv").write(tmp_path / "idle.csv")
    said = call(capsys, monkeypatch, "init", "idle.csv")
    assert said.code == 0, said.err
    assert "idle.csv: 400 rows, 1 s apart" in said.out
    assert "Q2    left out, 0 throughout" in said.out
    assert "T1 answers to Q1.\nT2 answers to Q1." in said.out
    assert "Not sure" not in said.out
    assert said.out.endswith("Next: plantfit check idle.toml\n")
    next(s for s in STYLES if s.name == "noise.csv").write(tmp_path / "noise.csv")
    assert "Not sure of 'AI1' (input)" in call(capsys, monkeypatch, "init", "noise.csv").out
    assert (
        "Not sure"
        not in call(capsys, monkeypatch, "init", "noise.csv", "--force", "--input", "AI1", "--output", "AI0").out
    )


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ("t [s],u [V],T [degC]", "T answers to u."),
        ("t [s],Coil voltage [V],speed [rpm]", "speed answers to Coil_voltage."),
        ("t [s],x [m],i [A]", "i answers to 'x' (u in the study file)."),
        ("t [s],u [V],2nd level [mm]", "'2nd level' (c2nd_level in the study file) answers to u."),
    ],
)
def test_what_answers_to_what_is_told_by_the_names_of_the_columns(tmp_path, capsys, monkeypatch, header, told):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    u = prbs(rng, 400, 20, -1, 1)
    columns = [0.1 * np.arange(400), u, lag(u, 2.0, 10.0) + rng.normal(0, 0.01, 400)]
    np.savetxt(tmp_path / "a.csv", np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    said = " ".join(call(capsys, monkeypatch, "init", "a.csv", "--yes").out.split())
    assert told in said


def test_an_output_that_nothing_moves_is_said_to_be_one(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    n = 1200
    valve, supply = prbs(rng, n, 40, 0, 1), 60.0 + lag(np.cumsum(rng.normal(0, 0.05, n)), 1.0, 40.0)
    outlet = lag(supply, 1.0, 8.0) - lag(valve, 20.0, 8.0)
    columns = [np.arange(n), valve, supply + rng.normal(0, 0.02, n), outlet + rng.normal(0, 0.02, n)]
    header = "t_s,valve_u,temp1_degC,temp2_degC"
    np.savetxt(tmp_path / "ex.csv", np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    said = " ".join(call(capsys, monkeypatch, "init", "ex.csv", "--yes").out.split())
    assert (
        "temp1_degC does not seem to answer to valve_u: leave it out, or make it an input (--input 'temp1_degC')."
        in said
    )
    assert "temp2_degC answers to valve_u." in said
    named = call(
        capsys,
        monkeypatch,
        "init",
        "ex.csv",
        "--force",
        "--input",
        "temp1_degC",
        "--input",
        "valve_u",
        "--output",
        "temp2_degC",
    )
    assert "No answer" not in named.out


def test_named_columns_win(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    next(s for s in STYLES if s.name == "two.csv").write(tmp_path / "two.csv")
    said = call(
        capsys, monkeypatch, "init", "two.csv", "--json", "--input", "Heater_2", "--output", "Temperature 2 (degC)"
    )
    told = json.loads(said.out)
    assert (told["inputs"], told["outputs"]) == (["Heater_2"], ["Temperature_2"])
    turned = ["--input", "Temperature 2 (degC)", "--output", "Heater_2"]
    said = call(capsys, monkeypatch, "init", "two.csv", "--json", "--force", *turned)
    roles = {c["header"]: c["role"] for c in json.loads(said.out)["columns"]}
    assert (roles["Temperature 2 (degC)"], roles["Heater 2 (%)"]) == ("input", "output")
    said = " ".join(call(capsys, monkeypatch, "init", "two.csv", "--force", *turned).out.split())
    assert "Temperature 2 (degC) input, named by --input" in said
    assert "Heater 2 (%) output, named by --output" in said
    for words, message in (
        (["--input", "Heater 9"], "two.csv has no column of numbers 'Heater 9'; its columns of numbers are ["),
        (["--input", "Heater_1", "--output", "Heater_1"], "'Heater 1 (%)' is both input and output"),
    ):
        said = call(capsys, monkeypatch, "init", "two.csv", "--force", *words)
        assert said.code == 3
        assert message in " ".join(said.err.split())


def test_a_hostile_file_name_stays_a_comment(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = "a\nname = 'other' #.csv"
    next(s for s in STYLES if s.name == "plain.csv").write(tmp_path / name)
    said = call(capsys, monkeypatch, "init", name, "--json", "--out", "made.toml")
    assert said.code == 0, said.err
    assert spec.load(tmp_path / "made.toml").plan.name != "other"


@pytest.mark.thorough
def test_an_unsure_guess_is_asked_in_a_terminal(tmp_path):
    """Two columns that tell nothing: the answer counts; a wrong name is asked again; --yes asks nothing."""
    rng = np.random.default_rng(1)
    a, b = (lag(rng.normal(0, 1, 400), 1.0, 8.0) for _ in range(2))
    rows = "\n".join(f"{k},{p:.5f},{q:.5f}" for k, (p, q) in enumerate(zip(a, b, strict=True)))
    (tmp_path / "two.csv").write_text(f"t,p,q\n{rows}\n")

    def answered(lines, *words):
        own, other = pty.openpty()
        environment = {**os.environ, "COLUMNS": "120", "PYTHONPATH": str(Path(plantfit.__file__).parents[1])}
        program = subprocess.Popen(
            [sys.executable, "-m", "plantfit", "init", "two.csv", "--force", *words],
            cwd=tmp_path, stdin=other, stdout=other, stderr=other, env=environment,
        )  # fmt: skip
        os.close(other)
        os.write(own, lines.encode())
        read = []

        def listen():
            try:
                while chunk := os.read(own, 4096):
                    read.append(chunk)
            except OSError:  # the terminal is gone with the program
                pass

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        assert program.wait(120) == 0
        thread.join(5)
        os.close(own)
        return b"".join(read).decode()

    said = answered("nothing\nq\np\n")
    assert "has no column of numbers 'nothing'" in " ".join(said.split())
    assert "p answers to q." in said
    said = answered("p\nq\n")
    assert "q answers to p." in said
    assert "with commas between" not in answered("", "--yes")


@pytest.fixture(params=[False, pytest.param(True, marks=pytest.mark.slow)], ids=["written", "compared"])
def asked(request, monkeypatch):
    """The names of the candidates that are to be compared; None where they are, which takes four fits. The two of rows
    at rest are always compared."""
    if request.param:
        return None
    names: list[str] = []
    monkeypatch.setattr(init, "_compared", lambda files, json: names.extend(file.name for file in files))
    return names


def test_candidates_are_fitted_and_compared(asked, tmp_path, capsys, monkeypatch):
    """A first-order plant with dead time, a speed in turns a minute in a German file: the one without is told apart,
    the second order is not called better."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(2)
    u = prbs(rng, 500, 25, 0, 10)
    y = 20 + lag(u, 1.0, 12.0, 0.8, 6) + rng.normal(0, 0.05, 500)
    rows = "\n".join(f"{k};{p};{q:.4f}".replace(".", ",") for k, (p, q) in enumerate(zip(u, y, strict=True)))
    (tmp_path / "plant.csv").write_text(f"t [s];PWM [%];n [U/min]\n{rows}\n")
    said = call(capsys, monkeypatch, "init", "plant.csv", "--candidates", "--json")
    assert said.code == 0, said.err
    kinds = ("first", "dead_time", "second", "integrating")
    assert {f.name for f in tmp_path.glob("*.toml")} == {f"plant-{k}.toml" for k in kinds}
    for kind in kinds:
        (experiment,) = spec.load(tmp_path / f"plant-{kind}.toml").problem.experiments.values()
        assert np.ptp(experiment.recording["n"]) == pytest.approx(np.ptp(y), abs=1e-4)
    if asked is not None:
        assert asked == [f"plant-{k}.toml" for k in kinds]
        return
    told = json.loads(said.out)
    first = told["verdict"][0]["sentence"]
    assert first.startswith(
        ("The data do not tell plant-dead_time.toml and plant-second.toml apart", "plant-dead_time.toml predicts")
    )
    rmse = {m["name"]: m for m in told["models"]}
    assert set(rmse) >= {"plant-first.toml", "plant-dead_time.toml", "plant-second.toml"}
    assert "plant-first.toml" in first
    assert (tmp_path / "plant-candidates.html").exists()


def test_a_position_that_sums_up_what_drives_it_is_among_the_candidates(asked, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    u = prbs(rng, 800, 25, -6, 6)
    angle = np.cumsum(30.0 * lag(u, 0.02, 0.15, 1.0, 2)) * 0.02
    rows = "\n".join(
        f"{20 * k},{p},{q + 0.3 * rng.normal():.2f}" for k, (p, q) in enumerate(zip(u, angle, strict=True))
    )
    (tmp_path / "encoder.csv").write_text(f"millis,u [V],pos [deg]\n{rows}\n")
    said = call(capsys, monkeypatch, "init", "encoder.csv", "--candidates", "--json")
    assert said.code == 0, said.err
    if asked is None:
        told = json.loads(said.out)
        assert told["verdict"][0]["sentence"].startswith("encoder-integrating.toml predicts unseen data best")
    else:
        assert "encoder-integrating.toml" in asked
    text = (tmp_path / "encoder-integrating.toml").read_text("utf-8")
    assert "x' = v" in text
    assert 'unit = "deg/s/V"' in text


@pytest.mark.parametrize("word", ["Err", ""])
def test_an_input_with_cells_without_a_number_is_held_over_them(tmp_path, capsys, monkeypatch, word):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    u = prbs(rng, 400, 20, 0, 10)
    y = 20 + lag(u, 1.0, 8.0, 0.8) + rng.normal(0, 0.05, 400)
    cells = [f"{p:g}" for p in u]
    cells[50], cells[201] = word, word
    rows = "\n".join(f"{k},{p},{q:.3f}" for k, (p, q) in enumerate(zip(cells, y, strict=True)))
    (tmp_path / "plant.csv").write_text(f"t [s],u [V],y [degC]\n{rows}\n", "utf-8")
    assert call(capsys, monkeypatch, "init", "plant.csv", "--yes").code == 0
    [experiment] = spec.load(tmp_path / "plant.toml").problem.experiments.values()
    filled = experiment.recording["u"]
    assert filled[[50, 201]].tolist() == filled[[49, 200]].tolist()
    assert ('missing = ["Err"]' in (tmp_path / "plant.toml").read_text("utf-8")) == bool(word)


def test_a_file_without_an_output_and_a_folder_that_is_missing_are_told(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{0.1 * k:.1f},{k % 7},2" for k in range(50))
    Path("still.csv").write_text(f"t,u,y\n{rows}\n", "utf-8")
    said = call(capsys, monkeypatch, "init", "still.csv", "--yes")
    assert said.code == 3
    assert "only 'u' changes" in " ".join(said.err.split())
    Path("moves.csv").write_text(
        "t,u,y\n" + "\n".join(f"{0.1 * k:.1f},{k // 9 % 2},{k % 5}" for k in range(50)) + "\n", "utf-8"
    )
    said = call(capsys, monkeypatch, "init", "moves.csv", "--yes", "--out", "missing/study.toml")
    assert said.code != 0
    assert "There is no folder 'missing'" in " ".join(said.err.split())


@pytest.mark.parametrize(
    ("rows", "lines"),
    [
        ("0,1,1\n1,1,2\n1,1,2.1\n2,1,3\n3,0,2\n4,0,1\n5,1,2\n", ['duplicates = "mean"']),
        ("0,1,1\n2,1,2\n1,1,2.1\n3,1,3\n4,0,2\n5,0,1\n6,1,2\n", ["sort = true"]),
        ("0,1,1\n2,1,2\n1,1,2.1\n2,1,3\n3,0,2\n4,0,1\n5,1,2\n", ["sort = true", 'duplicates = "mean"']),
    ],
)
def test_times_that_go_back_or_stand_twice_are_treated_in_the_file(tmp_path, capsys, monkeypatch, rows, lines):
    (tmp_path / "a.csv").write_text("t,u,y\n" + rows)
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "init", "a.csv", "--yes")
    assert said.code == 0, said.err
    table = tomllib.loads((tmp_path / "a.toml").read_text())["recording"]["data"]
    assert [
        f"{k} = {'true' if table[k] is True else chr(34) + table[k] + chr(34)}"
        for k in ("sort", "duplicates")
        if k in table
    ] == lines
    for line in lines:
        assert f"The study file treats this with {line}" in said.out
    (experiment,) = spec.load(tmp_path / "a.toml").problem.experiments.values()
    assert np.all(np.diff(experiment.recording.t) == 1.0)


def test_every_parameter_says_what_it_is(capsys, monkeypatch, tmp_path):
    heater(tmp_path)
    assert call(capsys, monkeypatch, "init", str(tmp_path / "heater.csv"), "--yes", "--force").code == 0
    written = tomllib.loads((tmp_path / "heater.toml").read_text("utf-8"))["parameters"]
    told = [p["sentence"] for p in written.values()]
    assert len(told) > 3
    assert "static gain from u to T" in told
    assert "dead time of T" in told


@pytest.mark.parametrize(("name", "unit"), [
    ("temp1_degC", "degC"), ("heater_V", "V"), ("speed_rad_s", "rad/s"), ("p_mbar", "mbar"), ("level_pct", "%"),
    ("flow_l_min", "l/min"),
    ("run_1", None), ("x_m", None), ("motor_A", None), ("T_K", None), ("_V", None), ("degC", None), ("leverage", None),
    ("phase_s", None),
])  # fmt: skip
def test_a_unit_that_a_name_ends_in_is_taken_where_it_is_sure(name, unit):
    from plantfit.recording.readers.columns import unit_in_name

    assert unit_in_name(name) == unit


def test_units_of_names_and_umlauts_reach_the_study(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    t, u, x = np.arange(300.0), np.repeat(rng.uniform(0, 10, 15), 20), np.zeros(300)
    for k in range(299):
        x[k + 1] = x[k] + (2 * u[k] - x[k]) / 25
    rows = "\n".join(
        f"{a:.1f};{b:.3f};{c:.3f};{c + 3:.3f}" for a, b, c in zip(t, u, x + rng.normal(0, 0.1, 300), strict=True)
    )
    (tmp_path / "tank.csv").write_text("time_s;heater_V;temp_degC;Füllstand (mm)\n" + rows, "utf-8")
    assert call(capsys, monkeypatch, "init", "tank.csv", "--yes").code == 0
    text = (tmp_path / "tank.toml").read_text("utf-8")
    assert 'units = { heater_V = "V", temp_degC = "degC" }' in text
    assert 'Fuellstand = "Füllstand (mm)"' in text
    assert set(spec.load(tmp_path / "tank.toml").problem.outputs) == {"temp_degC", "Fuellstand"}


def test_columns_with_names_that_equations_use_get_other_ones(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    t, u, x = np.arange(300.0), np.repeat(rng.uniform(0, 10, 15), 20), np.zeros(300)
    for k in range(299):
        x[k + 1] = x[k] + (2 * u[k] - x[k]) / 25
    rows = "\n".join(f"{a},{b:.3f},{c:.3f}" for a, b, c in zip(t, u, x + rng.normal(0, 0.1, 300), strict=True))
    (tmp_path / "slide.csv").write_text("time [s],step [V],pos [mm]\n" + rows, "utf-8")
    assert call(capsys, monkeypatch, "init", "slide.csv", "--yes").code == 0
    assert 'signals = { u = "step [V]", y = "pos [mm]" }' in (tmp_path / "slide.toml").read_text("utf-8")
    assert spec.load(tmp_path / "slide.toml").problem.outputs


@pytest.mark.parametrize(("low", "told"), [(0.0, False), (0.8, True)])
def test_a_rest_that_no_input_came_near_is_called_an_extrapolation(low, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u, x = np.repeat(np.random.default_rng(1).uniform(low, 5.0, 15), 20), np.zeros(300)
    u[:20] = low
    for k in range(299):
        x[k + 1] = x[k] + (2 * u[k] - x[k]) / 25
    rows = np.column_stack([np.arange(300.0), u, x + 0.1 * np.random.default_rng(2).normal(size=300)])
    np.savetxt("pump.csv", rows, delimiter=",", header="t_s,pump_V,level_mm", comments="", fmt="%.5g")
    assert call(capsys, monkeypatch, "init", "pump.csv", "--yes").code == 0
    sentence = tomllib.loads((tmp_path / "pump.toml").read_text("utf-8"))["parameters"]["rest"]["sentence"]
    assert sentence == "where level_mm rests without input" + (
        " (an extrapolation: pump_V was never below 0.8 V)" if told else ""
    )


def test_a_bracket_that_holds_no_unit_is_told_once_and_the_column_keeps_its_name(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{k},{k // 9 % 2},{k % 5},{k}" for k in range(50))
    Path("a.csv").write_text(f"t [s],u [V],speed [blub],n [0]\n{rows}\n", "utf-8")
    said = call(capsys, monkeypatch, "init", "a.csv", "--yes", "--input", "u", "--output", "speed [blub]")
    assert said.code == 0, said.err
    told = (
        "'blub' in the header 'speed [blub]' is not a known unit and counts as part of the name; correct it, or "
        "state the unit in units."
    )
    assert " ".join(said.out.split()).count(told) == 1
    assert "'0' in the header" not in said.out
    recording = spec.load(tmp_path / "a.toml").problem.experiments["data"].recording
    assert told in recording.log
    stated = plantfit.recording.read_csv("a.csv", signals={"v": "speed [blub]"}, units={"v": "rpm"})
    assert not any("not a known unit" in sentence for sentence in stated.log)


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        (".", None, "'.' is a folder; name a file in it."),
        ("two.csv", "t,u,u,y\n0,1,2,3\n1,0,3,2\n2,1,4,3\n3,2,2,4\n4,1,2,2\n",
         "two.csv has 2 columns 'u'; give each its own "
            "name in the header."),
        ("c.csv", "t,u,y\n0,1,5,2,5\n1,0,5,3,5\n", "c.csv, line 2: 5 cells where the first row has 3 (delimiter ','); "
                                                   "correct or delete the line "
         "(if its numbers have decimal commas, separate the columns by semicolons)."),
        ("b.csv", "\0\0", "'b.csv' is not text; save it as CSV, or give its name the ending of its "
            "format"),
        ("t.csv", "t,u,y\n0,1,2\n1,x,3\n2,1,4\n3,2,2\n",
         "can be made from this recording (t.csv, line 3, column 'u': 'x' is "
            "not a number;"),
    ],
)  # fmt: skip
def test_what_cannot_become_a_study_is_told_with_the_place(file, text, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path(file).write_text(text, "utf-8")
    said = call(capsys, monkeypatch, "init", file, "--yes")
    assert said.code == 3
    assert told in " ".join(said.err.split())


@pytest.mark.thorough
def test_a_study_with_samples_of_a_laboratory_passes_check(tmp_path, capsys, monkeypatch):
    """One biomass and one substrate an hour, and a feed that is held: as a fermenter's file."""
    rows = ["time [h],feed [ml/h],S [g/l]"]
    level = 9.0
    for k in range(113):
        feed = 0.0 if k < 40 else 20.0 + 10.0 * (k // 24)
        level += 0.25 * (0.02 * feed - 0.1 * level)
        rows.append(f"{0.25 * k:.2f},{feed},{f'{level:.2f}' if k % 11 == 0 else ''}")
    (tmp_path / "lab.csv").write_text("\n".join(rows))
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "init", "lab.csv", "-y")
    assert said.code == 0, said.err
    assert "S answers to feed." in said.out
    said = call(capsys, monkeypatch, "check", "lab.toml")
    assert said.code == 0, said.err
    assert "ready: plantfit run" in said.out


def test_newest_row_first_and_a_gauge_pressure_give_a_study_that_parses(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u = prbs(np.random.default_rng(7), 300, 9, 20.0, 60.0)
    p = 1.5 + 0.1 * lag(u, 60.0, 600.0)
    rows = [f"{60 * k},{u[k]},{p[k]:.4f}\n" for k in range(300)]
    Path("vessel.csv").write_text("t [s],valve [%],pressure (bar(g))\n" + "".join(rows[::-1]))
    said = call(capsys, monkeypatch, "init", "vessel.csv", "--yes")
    assert said.code == 0, said.err
    assert "300 rows, 60 s apart" in said.out
    assert spec.load(tmp_path / "vessel.toml").problem.outputs
    assert '= "bar" }    # ' in (tmp_path / "vessel.toml").read_text("utf-8")


@pytest.mark.parametrize("model", [(), ("--model", "dc_motor")])
def test_words_in_place_of_numbers_are_written_as_missing(model, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t, u = np.arange(300) * 0.01, prbs(np.random.default_rng(1), 300, 20, -3.0, 3.0)
    cells = [f"{w:.3f}" for w in 20.0 * lag(u, 0.01, 0.1)]
    cells[40:42] = ["Bad", "Bad"]
    rows = [f"{a:.2f},{b:.1f},{c}" for a, b, c in zip(t, u, cells, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time [s],u [V],w [rad/s]", *rows]) + "\n", "utf-8")
    said = call(capsys, monkeypatch, "init", "log.csv", *model)
    assert said.code == 0, said.err
    assert "2 cells with 'Bad' in place of a number: the study file counts them as missing." in said.out
    [experiment] = spec.load(tmp_path / "log.toml").problem.experiments.values()
    assert np.flatnonzero(np.isnan(experiment.recording["w"])).tolist() == [40, 41]


@pytest.mark.parametrize(
    ("low", "high", "fitted"),
    [(0, 1, False), (-1, 1, False), (1, 2, False), pytest.param(0, 1, True, marks=pytest.mark.slow)],
)
@pytest.mark.further(2)
def test_a_duty_with_its_direction_in_another_column_becomes_a_plant_that_turns_both_ways(
    tmp_path, capsys, monkeypatch, low, high, fitted
):
    rng = np.random.default_rng(5)
    duty, up = np.repeat(rng.integers(0, 256, 20), 30), np.repeat(rng.integers(0, 2, 24), 25)
    rows, w = ["millis,pwm,dir,rpm\n"], 0.0
    for k in range(600):
        rows.append(f"{20 * k},{duty[k]},{high if up[k] else low},{w + rng.normal(0, 2):.1f}\n")
        w += 0.15 * (7.0 * duty[k] * (1 if up[k] else -1) - w)
    (tmp_path / "m.csv").write_text("".join(rows))
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "init", "m.csv", "--yes")
    assert said.code == 0, said.err
    assert "'dir' gives it its sign" in said.out
    assert "K*delay(pwm_signed, L) + rest" in (tmp_path / "m.toml").read_text()
    assert "rpm answers to pwm_signed." in said.out
    look = call(capsys, monkeypatch, "look", "m.toml")
    assert "rpm reacts to pwm_signed within a sample" in look.out
    look = call(capsys, monkeypatch, "look", "m.csv")
    assert "'pwm' has no sign and 'dir' gives it one: they are one input, pwm_signed" in look.out
    assert "rpm reacts to pwm_signed within a sample" in look.out
    look = call(capsys, monkeypatch, "look", "m.csv", "--input", "pwm")
    assert "'pwm' has no sign and 'dir' gives it one, which is not in what follows" in look.out
    (tmp_path / "one_way.csv").write_text("".join(rows[:1] + [r for r in rows[1:] if r.split(",")[2] == str(high)]))
    assert "has no sign" not in call(capsys, monkeypatch, "look", "one_way.csv").out
    if fitted:
        assert "a fit of 99" in call(capsys, monkeypatch, "run", "m.toml", "--no-diagnose").out


@pytest.mark.parametrize(
    ("header", "step", "told"),
    [
        ("t", 50, True),
        ("time", 20, True),
        ("t", 1, False),
        ("t_ms", 50, False),
        ("time [s]", 50, False),
        ("t", 0.5, False),
    ],
)
def test_whole_numbers_without_a_unit_may_be_milliseconds(tmp_path, capsys, monkeypatch, header, step, told):
    rows = "".join(f"{step * k:g},{k // 9 % 2},{(k % 9) / 9:.2f}\n" for k in range(80))
    (tmp_path / "a.csv").write_text(f"{header},u,y\n{rows}")
    monkeypatch.chdir(tmp_path)
    said = " ".join(call(capsys, monkeypatch, "init", "a.csv", "--yes").out.split())
    assert ('write time_unit = "ms" or "min" below time' in said) is told
    if told:
        study = (tmp_path / "a.toml").read_text().replace("split = 0.7", 'time_unit = "ms"\nsplit = 0.7')
        (tmp_path / "a.toml").write_text(study)
        (experiment,) = spec.load(tmp_path / "a.toml").problem.experiments.values()
        assert experiment.recording.t[-1] == pytest.approx(0.001 * step * 79)


def test_dates_that_can_be_exchanged_are_told_by_an_option(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exchangeable(tmp_path / "log.csv")
    refused = call(capsys, monkeypatch, "init", "log.csv", "--yes")
    assert refused.code != 0
    assert "day and month can be exchanged in all of its dates; give --dates" in refused.err
    assert 'give --dates "day first" or --dates "month first", or the dates as 2024-05-31' in refused.err
    assert not (tmp_path / "log.toml").exists()
    last = {}
    for order in ("day first", "month first"):
        said = call(capsys, monkeypatch, "init", "log.csv", "--yes", "--force", "--dates", order)
        assert said.code == 0, said.err
        table = tomllib.loads((tmp_path / "log.toml").read_text("utf-8"))["recording"]["data"]
        assert (table["time"], table["dates"]) == ("time", order)
        (experiment,) = spec.load(tmp_path / "log.toml").problem.experiments.values()
        last[order] = float(experiment.recording.t[24 * 2])
    # of the third day: 2 March and 3 February
    assert last == {"day first": 61 * 86400.0, "month first": 33 * 86400.0}


def test_no_order_is_written_where_none_was_given_and_a_wrong_one_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heater(tmp_path)
    assert call(capsys, monkeypatch, "init", "heater.csv", "--yes", "--force").code == 0
    assert "dates" not in (tmp_path / "heater.toml").read_text("utf-8")
    wrong = call(capsys, monkeypatch, "init", "heater.csv", "--force", "--dates", "dmy")
    assert "--dates 'dmy': write one of 'day first', 'month first', 'year first'" in wrong.err
    numbers = call(capsys, monkeypatch, "init", "heater.csv", "--force", "--dates", "day first")
    assert "the times of heater.csv are no dates; leave it out" in numbers.err


def test_a_first_look_takes_the_order_of_day_and_month(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exchangeable(tmp_path / "log.csv")
    heater(tmp_path)
    refused = call(capsys, monkeypatch, "look", "log.csv")
    assert refused.code != 0
    assert 'give --dates "day first" or --dates "month first", or the dates as 2024-05-31' in refused.err
    assert "[recording.NAME]" not in refused.err
    found = {}
    for order in ("day first", "month first"):
        said = call(capsys, monkeypatch, "look", "log.csv", "--dates", order, "--json")
        assert said.code == 0, said.err
        t = said.record("look")["outputs"][0]["t"]
        found[order] = t[-1] - t[0]
    assert found["day first"] == found["month first"]  # the ends are as far apart
    wrong = call(capsys, monkeypatch, "look", "log.csv", "--dates", "dmy")
    assert "--dates 'dmy': write one of 'day first', 'month first', 'year first'" in wrong.err
    numbers = call(capsys, monkeypatch, "look", "heater.csv", "--dates", "day first")
    assert "the times of heater.csv are no dates; leave it out" in numbers.err
    study = call(capsys, monkeypatch, "look", "heater.toml", "--dates", "day first")
    assert "heater.toml says it with dates under [recording.NAME]" in study.err
    assert call(capsys, monkeypatch, "look", "heater.csv").code == 0  # asks for no order


def _curve(place, kind):
    """A table without times: levels of a curve in any order or sorted, an input that is late by three rows, a lag."""
    rng = np.random.default_rng(1)
    n = 12 if kind == "few" else 40 if kind in ("any", "sorted") else 200
    u = np.linspace(0.0, 10.0, n)
    if kind != "sorted":
        u = rng.permutation(u)
    if kind == "lag":
        u = np.repeat(u[::12], 12)[:n]
    y = 2.0 + 3.0 * u - 0.1 * u**2
    if kind == "late":
        y = np.roll(y, 3)
    for k in range(1, n if kind == "lag" else 0):
        y[k] = 0.8 * y[k - 1] + 0.2 * y[k]
    y = y + 0.05 * rng.standard_normal(n)
    rows = [f"{a:.6g},{b:.6g}" for a, b in zip(u, y, strict=True)]
    place.write_text("flow [l/min],pressure [bar]\n" + "\n".join(rows) + "\n")


@pytest.mark.parametrize("kind", ["any", "few", "sorted", "late", "lag"])
def test_rows_without_times_that_are_no_motion_get_models_without_dynamics(tmp_path, capsys, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    _curve(tmp_path / "curve.csv", kind)
    said = call(capsys, monkeypatch, "init", "curve.csv", "--yes")
    assert said.code == 0, said.err
    text = (tmp_path / "curve.toml").read_text("utf-8")
    study = spec.load(tmp_path / "curve.toml")
    at_rest = kind in ("any", "few", "sorted")
    assert ("the models are without dynamics. If the rows were recorded one after the other" in said.out) is at_rest
    assert ("No time column was found" in said.out) is not at_rest
    assert (f"and {'the rows are sorted' if kind == 'sorted' else 'no row hangs'}" in said.out) is at_rest
    assert ("a straight line of the inputs, without dynamics; --candidates compares 2 kinds" in said.out) is at_rest
    assert all(e.steady is at_rest for e in study.problem.experiments.values())
    assert bool(getattr(study.problem.model, "states", None)) is not at_rest
    assert ("tau" in text) is not at_rest
    assert ("\nsplit = 0.7" in text) is (kind != "sorted")


def test_times_make_a_motion_of_the_same_rows(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _curve(tmp_path / "curve.csv", "any")
    header, *rows = (tmp_path / "curve.csv").read_text("utf-8").splitlines()
    timed = [f"t [s],{header}", *(f"{k},{row}" for k, row in enumerate(rows))]
    (tmp_path / "timed.csv").write_text("\n".join(timed))
    said = call(capsys, monkeypatch, "init", "timed.csv", "--yes")
    assert "without dynamics" not in said.out
    assert getattr(spec.load(tmp_path / "timed.toml").problem.model, "states", None)


def test_candidates_of_rows_at_rest_are_a_line_and_a_parabola(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _curve(tmp_path / "curve.csv", "any")
    said = call(capsys, monkeypatch, "init", "curve.csv", "--yes", "--candidates")
    assert said.code == 0, said.err
    assert sorted(p.name for p in tmp_path.glob("*.toml")) == ["curve-line.toml", "curve-parabola.toml"]
    assert "curve-parabola.toml predicts unseen data better" in said.out
    assert (tmp_path / "curve-candidates.html").exists()
