"""`plantfit run --pieces`: what a verdict tells to do with a record that forgets its start, done by one command."""

import json
import re
import tomllib

import numpy as np
import pytest
from cli_call import call
from scipy.integrate import solve_ivp

from plantfit.cli.commands.begin.check import say_looks

STUDY = """name = "well"
[recording.run]
file = "run.csv"
[model]
equations = "x' = v\\nv' = b*x - c*x^3 - d*v + u\\ny = x"
inputs = ["u"]
states = ["x", "v"]
outputs = ["y"]
[parameters]
b = { bounds = [0.1, 10] }
c = { bounds = [0.1, 10] }
d = { bounds = [0.01, 1] }
[search]
budget = 600
"""


def written(folder, until=80):
    """A double well driven into chaos (Holmes, Phil. Trans. R. Soc. A 292 (1979) 419): b 1, c 1, d 0.3, with noise."""
    t = np.arange(0, until, 0.1)
    u = np.round(0.5 * np.cos(1.2 * t), 4)
    x, rows = np.array([1.0, 0.0]), []
    for now in u:
        rows.append(x[0])
        x = solve_ivp(
            lambda s, x, now=now: [x[1], x[0] - x[0] ** 3 - 0.3 * x[1] + now], (0, 0.1), x, rtol=1e-10, atol=1e-12
        ).y[:, -1]
    y = np.array(rows) + 0.01 * np.random.default_rng(3).normal(size=len(t))
    np.savetxt(folder / "run.csv", np.c_[t, u, y], delimiter=",", header="t [s],u,y", comments="")
    (folder / "well.toml").write_text(STUDY, "utf-8")


@pytest.mark.slow
def test_the_verdict_of_a_record_that_forgets_its_start_names_the_command(tmp_path, monkeypatch, capsys):
    written(tmp_path)
    monkeypatch.chdir(tmp_path)
    whole = call(capsys, monkeypatch, "run", "well.toml", "--no-diagnose")
    assert "forgets its start" in whole.out
    named = re.search(r"`plantfit run well.toml --pieces (\d+)`", whole.out)
    assert named
    assert 2 <= int(named[1]) <= 40


@pytest.mark.parametrize("until", [20, pytest.param(80, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_the_command_that_the_verdict_names_gives_the_truth(until, tmp_path, monkeypatch, capsys):
    written(tmp_path, until)
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "run", "well.toml", "--pieces", "10", "--no-diagnose", "--json")
    assert said.code == 0
    rows = {p["name"]: p for p in json.loads(said.out)["parameters"]}
    for name, truth in {"b": 1.0, "c": 1.0, "d": 0.3}.items():
        assert rows[name]["status"] == "determined"
        assert abs(rows[name]["value"] - truth) < 4 * rows[name]["standard_error"] < 0.1 * truth
    assert tomllib.loads((tmp_path / "well-in-pieces.toml").read_text("utf-8"))["recording"]["run"]["pieces"] == 10


def test_a_file_in_its_place_is_not_overwritten_and_one_study_is_cut_at_a_time(tmp_path, monkeypatch, capsys):
    written(tmp_path, 20)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "well-in-pieces.toml").write_text('name = "mine"\n', "utf-8")
    said = call(capsys, monkeypatch, "run", "well.toml", "--pieces", "10")
    assert said.code != 0
    assert "'well-in-pieces.toml' exists already and says something else" in said.err.replace("\n", " ")
    assert (tmp_path / "well-in-pieces.toml").read_text("utf-8") == 'name = "mine"\n'
    for words in (("well.toml", "well.toml"), ("well.toml", "--try", "dead time of u")):
        said = call(capsys, monkeypatch, "run", *words, "--pieces", "10")
        assert said.code != 0
        assert "--pieces changes one study file" in said.err
    assert sorted(p.name for p in tmp_path.glob("*.toml")) == ["well-in-pieces.toml", "well.toml"]  # none with a --try


def test_what_is_odd_in_many_pieces_is_said_once(capsys):
    def look(k, share, signal="u", late=""):
        told = f"Past values of y explain {share} % of what is new in {signal}{late}."
        return {"level": "warning", "kind": "feedback", "recording": f"data-{k}", "signal": signal, "other": "y",
                "sentence": told, "write": None}  # fmt: skip

    say_looks([look(k, 20 + k) for k in range(1, 7)] + [look(2, 90), look(3, 8, "w"), look(4, 9, late=", late")])
    told = " ".join(capsys.readouterr().out.split())
    assert told == (
        "! Past values of y explain 21 % of what is new in u. "
        "This is data-1; alike in data-2, data-3, data-4 and 2 more. "
        "! Past values of y explain 90 % of what is new in u. "
        "! Past values of y explain 8 % of what is new in w. ! Past values of y explain 9 % of what is new in u, late."
    )
