"""`plantfit new`: study files from lists of parts and from the library, columns of a recording, and mistakes."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli_call import call, exchangeable

import plantfit as pf
from plantfit.models.drawings.offered import drawings
from plantfit.models.library.catalogue import names
from plantfit.recording import from_arrays, to_csv

ROOT = Path(__file__).resolve().parents[2]
RC = "R1 resistor a b\nC1 capacitor b 0\nu source a 0\nmeasure v(b), i(R1)\n"
TRUE = {"R1": 2200.0, "C1": 4.7e-5}


def rc(folder, seed=1):
    """A circuit under steps, solved exactly between them, with noise of 1 % of a step."""
    t = np.arange(400) * 0.01
    u = np.where(np.sin(2 * np.pi * t / 0.9) > 0, 5.0, 1.0)
    v, tau = np.zeros(400), TRUE["R1"] * TRUE["C1"]
    for k in range(399):
        v[k + 1] = u[k] + (v[k] - u[k]) * np.exp(-0.01 / tau)
    noise = np.random.default_rng(seed)
    i = (u - v) / TRUE["R1"] + noise.normal(0, 2e-5, 400)
    v = v + noise.normal(0, 0.02, 400)
    to_csv(
        from_arrays(t, signals={"u": (u, "V"), "v_b": (v, "V"), "i_R1": (1000 * i, "mA")}, name="circuit"),
        folder / "circuit.csv",
    )


@pytest.mark.thorough
def test_a_list_of_parts_becomes_a_study_that_finds_the_parts(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "circuit.net").write_text(RC)
    said = call(capsys, monkeypatch, "new", "circuit.net")
    assert said.code == 0, said.err
    assert said.out.splitlines()[-1] == "Next: plantfit check circuit.toml"
    assert "circuit.csv with the columns t [s], u [V], v_b [V], i_R1 [A]" in said.out
    missing = call(capsys, monkeypatch, "check", "circuit.toml")
    assert missing.code == 3
    assert "'circuit.csv' does not exist" in missing.err
    rc(tmp_path)
    again = call(capsys, monkeypatch, "new", "circuit.net")
    assert again.code == 7
    assert "exists already" in again.err
    said = call(capsys, monkeypatch, "new", "circuit.net", "--force", "--recording", "circuit.csv", "--json")
    told = json.loads(said.out)
    assert told["columns"] == {"u": "u [V]", "v_b": "v_b [V]", "i_R1": "i_R1 [mA]"}
    assert told["without_column"] == []
    run = call(capsys, monkeypatch, "run", "circuit.toml", "--no-diagnose", "--json")
    assert run.code == 0, run.err
    for row in json.loads(run.out)["parameters"]:
        assert abs(row["value"] - TRUE[row["name"]]) < 4 * row["standard_error"]
        assert row["status"] == "determined"


@pytest.mark.parametrize("kind", [n for n in (*drawings(), *names()) if not n.endswith("_regression")])
def test_every_plant_to_begin_with_is_a_whole_study(kind, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "new", "mine", "--from", kind)
    assert said.code == 0, said.err
    text = (tmp_path / "mine.toml").read_text("utf-8")
    content = tomllib.loads(text)
    signals = content["recording"]["data"]["signals"]
    rng = np.random.default_rng(0)
    columns = {
        s: (rng.uniform(1, 2, 20), header.partition("[")[2].rstrip("]") or None) for s, header in signals.items()
    }
    to_csv(from_arrays(np.arange(20.0), signals=columns, name="mine"), tmp_path / "mine.csv")
    study = pf.load("mine.toml")
    assert study.problem.space.dimension >= 2
    if kind in drawings() and drawings()[kind].parts:  # its parts make the same file
        before = text.partition("[model]")[2]
        assert call(capsys, monkeypatch, "new", "mine.net", "--force").code == 0
        assert (tmp_path / "mine.toml").read_text("utf-8").partition("[model]")[2] == before


def recorded(folder, columns, name="r.csv"):
    t = np.arange(60.0)
    to_csv(from_arrays(t, signals={n: (f(t), u) for n, (f, u) in columns.items()}, name="r"), folder / name)


def steps(t):
    return np.where(t % 20 > 10, 50.0, 10.0)


def lag(t):
    return 20 + 10 * (1 - np.exp(-(t % 20) / 6))


PLATE = (
    "P heater plate by u\nC heat_capacity plate\nR heat_resistance plate room\nT0 surroundings room\nmeasure T(plate)\n"
)


def test_columns_are_found_by_name_by_unit_or_as_they_are_named(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plate.net").write_text(PLATE)
    recorded(tmp_path, {"power": (steps, "%"), "temp": (lag, "degC")})
    said = call(capsys, monkeypatch, "new", "plate.net", "--recording", "r.csv")
    assert said.code == 0, said.err
    assert "u: column 'power [%]'" in said.out
    assert "T_plate: column 'temp [degC]'" in said.out
    recorded(tmp_path, {"a": (steps, None), "b": (lag, None)})
    said = call(capsys, monkeypatch, "new", "plate.net", "--recording", "r.csv", "--force")
    assert "T_plate: no column was found, put yours there or write --column T_plate=NAME" in said.out
    said = call(
        capsys,
        monkeypatch,
        "new",
        "plate.net",
        "--recording",
        "r.csv",
        "--force",
        "--column",
        "u=a",
        "--column",
        "T_plate=b",
    )
    assert said.code == 0, said.err
    assert pf.load("plate.toml").problem.space.dimension == 4
    for words, code, told in (
        (["--column", "v=a"], 7, "no signal 'v'"),
        (["--column", "u=aa"], 3, "no such column. Did you mean 'a'?"),
    ):
        said = call(capsys, monkeypatch, "new", "plate.net", "--recording", "r.csv", "--force", *words)
        assert said.code == code
        assert told in said.err
    recorded(tmp_path, {"u": (steps, "V"), "T_plate": (lag, "degC")})
    said = call(capsys, monkeypatch, "new", "plate.net", "--recording", "r.csv", "--force")
    assert said.code == 3
    assert "'u [V]' is in V, and u in %" in said.err


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        ([], 7, "plantfit new circuit.net"),
        (["motor"], 7, "--from dc_motor"),
        (["gone.net"], 7, "There is no file 'gone.net'"),
        (["m", "--from", "dc_moter"], 5, "Did you mean 'dc_motor'?"),
        (["m", "--from", "drive_regression"], 5, "docs/regression.md"),
        (["m", "--from", "rc", "--out", "no/m.toml"], 7, "no folder 'no'"),
        (["m", "--from", "rc", "--column", "u=a"], 7, "--recording"),
        (["bad.net"], 5, "bad.net, line 1: there is no part 'resitor'"),
    ],
)
def test_mistakes_end_in_one_sentence(words, code, told, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.net").write_text("R resitor a b")
    said = call(capsys, monkeypatch, "new", *words)
    assert said.code == code
    assert told in said.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.net"]


def test_parts_and_plants_are_listed(capsys, monkeypatch):
    parts = call(capsys, monkeypatch, "new", "--parts").out
    assert "NAME gear fast slow" in parts
    assert "w(node) speed [rad/s]" in parts
    assert {p["kind"] for p in json.loads(call(capsys, monkeypatch, "new", "--parts", "--json").out)} >= {
        "tank",
        "motor",
    }
    plants = json.loads(call(capsys, monkeypatch, "new", "--list", "--json").out)
    assert {p["name"] for p in plants} >= {
        "dc_motor",
        "drive_train",
        "thermal",
        "tank",
        "exchanger",
        "pendulum",
        "mass_spring",
    }


@pytest.mark.slow
def test_the_tutorial_of_the_page_ends_as_it_says(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    section = (
        (ROOT / "docs" / "networks.md").read_text("utf-8").split("## From a drawing to a verdict")[1].split("\n## ")[0]
    )
    data = (ROOT / "src" / "plantfit" / "cases" / "heater" / "step_test.csv").read_text("utf-8")
    (tmp_path / "steps.csv").write_text("t_s,u,y [K]\n" + data)
    parts, known = re.findall(r"```text\n(.*?)```", section, re.DOTALL)
    sentences = [line[6:] for line in section.splitlines() if re.match(r"    [+i!x] ", line)]
    first, *_ = parts.splitlines()
    for text, told in ((parts, sentences[:2]), (parts.replace(first, known.strip()), sentences[2:])):
        (tmp_path / "board.net").write_text(text)
        assert call(capsys, monkeypatch, "new", "board.net", "--recording", "steps.csv", "--force").code == 0
        run = call(capsys, monkeypatch, "run", "board.toml", "--no-diagnose", "--json")
        verdict = [v["sentence"] for v in json.loads(run.out)["verdict"]]
        for sentence in told:
            shape = ".*".join(map(re.escape, re.split(r"\.\.\.|0\.413|1\.25|1\.3827 ± 0\.0095|322 ± 20", sentence)))
            assert any(re.match(shape, v) for v in verdict), (sentence, verdict)


@pytest.mark.parametrize(
    ("name", "kind", "place", "truth"),
    [
        ("exchanger", "exchanger", slice(0, 1), (900, 8000, 12000)),
        pytest.param("driven", "pendulum", slice(1, 3), (0.004, 0.5, 0.003), marks=pytest.mark.slow),  # a minute each
        pytest.param("free", "pendulum", slice(3, None), (125, 0.75), marks=pytest.mark.slow),
    ],
)
@pytest.mark.thorough
def test_the_exchanger_and_the_pendulum_of_the_page_end_as_it_says(
    capsys, monkeypatch, tmp_path, name, kind, place, truth
):
    """Its lines make the records; printed numbers are the page's, and the truth lies in what is said."""
    monkeypatch.chdir(tmp_path)
    section = (ROOT / "docs" / "networks.md").read_text("utf-8").split("## A heat exchanger and a pendulum")[1]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    exec(compile(code, "networks.md", "exec"), {})
    lines = [line[6:] for line in section.rpartition("```")[2].splitlines() if re.match(r"    [+i!x] ", line)][place]
    assert call(capsys, monkeypatch, "new", name, "--from", kind, "--recording", f"{name}.csv").code == 0
    run = call(capsys, monkeypatch, "run", f"{name}.toml", "--no-diagnose", "--json")
    verdict = [v["sentence"] for v in json.loads(run.out)["verdict"]]
    for line in lines:
        # another processor has other last digits
        shape = re.sub(r"\d[\d.]*", r"[\\d.]+", re.escape(line).replace(r"\ ", " "))
        assert any(re.match(shape, v) for v in verdict), (line, verdict)
    for (value, error), true in zip(re.findall(r"= ([\d.]+) ± ([\d.]+)", lines[0]), truth, strict=True):
        assert abs(float(value) - true) < 2.5 * float(error)


def test_a_name_with_its_ending_gets_no_second_one(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(capsys, monkeypatch, "new", "plate.toml", "--from", "exchanger").code == 0
    assert [p.name for p in tmp_path.iterdir()] == ["plate.toml"]


def test_dates_of_a_recording_that_can_be_exchanged_are_told_by_an_option(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exchangeable(tmp_path / "log.csv")
    rc(tmp_path)
    words = ("new", "k", "--from", "rlc", "--force", "--recording")
    refused = call(capsys, monkeypatch, *words, "log.csv")
    assert refused.code != 0
    assert 'give --dates "day first" or --dates "month first", or the dates as 2024-05-31' in refused.err
    assert not (tmp_path / "k.toml").exists()
    for order in ("day first", "month first"):
        assert call(capsys, monkeypatch, *words, "log.csv", "--dates", order).code == 0
        table = tomllib.loads((tmp_path / "k.toml").read_text("utf-8"))["recording"]["data"]
        assert (table["time"], table["dates"]) == ("time", order)
    assert call(capsys, monkeypatch, *words, "circuit.csv").code == 0
    assert "dates" not in (tmp_path / "k.toml").read_text("utf-8")  # where none was given
    numbers = call(capsys, monkeypatch, *words, "circuit.csv", "--dates", "day first")
    assert "the times of circuit.csv are no dates; leave it out" in numbers.err
    none = call(capsys, monkeypatch, *words[:-1], "--dates", "day first")
    assert "give its file with --recording" in none.err
