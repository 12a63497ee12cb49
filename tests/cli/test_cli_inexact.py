"""What no steps can follow is said by the commands that simulate at given values."""

import numpy as np
import pytest
from cli_call import call

from plantfit.cli.commands.begin.check import say_inexact

STUDY = '''name = "pole"
[recording.a]
file = "pole.csv"
time = "t"
[model]
equations = """
x' = k*x^2
y = x
"""
outputs = { y = "m" }
[model.states]
x = { initial = 1.0, unit = "m" }
[parameters.k]
bounds = [0.01, 0.5]
unit = "1/m/s"
'''
SAID = (
    "No steps make this simulation exact to 0.2 %: its error is as large as the outputs move, or larger, so do not "
    "use its numbers."
)


@pytest.fixture
def study(tmp_path):
    """x = 1/(1 - k t), whose pole is inside of the record for k = 0.3 and behind it for k = 0.1."""
    t = 0.5 * np.arange(12)
    lines = "\n".join(f"{v},{1.0 / (1.0 - 0.1 * v):.6g}" for v in t)
    (tmp_path / "pole.csv").write_text(f"t [s],y [m]\n{lines}\n")
    (tmp_path / "pole.toml").write_text(STUDY)
    return tmp_path / "pole.toml"


@pytest.mark.parametrize(("k", "said"), [("0.3", True), pytest.param("0.1", False, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_check_and_predict(study, k, said, capsys, monkeypatch):
    place = str(study.with_name("o.csv"))
    found = call(capsys, monkeypatch, "check", str(study), "--at", f"k={k}")
    assert (SAID in " ".join(found.out.split())) == said
    found = call(capsys, monkeypatch, "predict", str(study), "--set", f"k={k}", "-o", place)
    assert (SAID in " ".join(found.out.split())) == said


@pytest.mark.slow
@pytest.mark.parametrize(("k", "said"), [("0.3", True), ("0.1", False)])
def test_predict_as_json(study, k, said, capsys, monkeypatch):
    place = str(study.with_name("o.csv"))
    record = call(capsys, monkeypatch, "predict", str(study), "--set", f"k={k}", "-o", place, "--json").record(
        "predict"
    )
    assert record["step_error"] == (1.0 if said else None)


def test_check_says_of_the_middle_of_the_bounds_that_it_is_there(study, capsys, monkeypatch):
    """k = 0.255 has its pole inside of the record, and a search finds k = 0.1."""
    told = " ".join(call(capsys, monkeypatch, "check", str(study)).out.split())
    assert "At the middle of the bounds no steps make the simulation exact to 0.2 %" in told
    assert "do not use its numbers" not in told
    study.write_text(STUDY.replace("0.5]", "0.15]"))
    assert "no steps make" not in call(capsys, monkeypatch, "check", str(study)).out


@pytest.mark.parametrize(
    ("error", "said"), [(None, ""), (0.123, "its error is about 12 % of the spread of an output"), (1.0, "as large as")]
)
def test_the_size_of_the_error(error, said, capsys):
    say_inexact(error)
    told = " ".join(capsys.readouterr().out.split())
    assert said in told
    assert ("No steps make" in told) is (error is not None)
