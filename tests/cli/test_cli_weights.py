"""`check`, `run` and `report` tell the weights in force and who chose them; a stored study keeps the user's word."""

import json

import numpy as np
import pytest
from cli_call import call

STUDY = """\
name = "tank"
{scales}
[recording.bench]
file = "tank.csv"
time = "t [s]"
signals = {{ u = "u", y = "y [m]", q = "q [V]" }}
[model]
equations = \"\"\"
h' = (K*u - h)/tau
y = h
q = g*h
\"\"\"
inputs = ["u"]
states = {{ h = {{ unit = "m", initial = 0 }} }}
outputs = {{ y = "m", q = "V" }}
check_units = false
[parameters]
K = {{ bounds = [0.1, 10.0] }}
tau = {{ bounds = [0.5, 50.0] }}
g = {{ bounds = [0.1, 10.0] }}
[search]
runs = 2
budget = 1500
"""

GUESSED = "y {} m (standard deviation of the record, until the fit estimates it from the residuals)"


def tank(folder, scales: str) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 40.0, 0.2)
    u = np.where(t > 2.0, 1.0, 0.0)
    h = np.where(t > 2.0, 2.0 * (1 - np.exp(-(t - 2.0) / 6.0)), 0.0)
    y, q = h + 0.02 * rng.normal(size=len(t)), 3.0 * h + 0.3 * rng.normal(size=len(t))
    rows = [f"{a:.2f},{b:g},{c:.6f},{d:.6f}" for a, b, c, d in zip(t, u, y, q, strict=True)]
    (folder / "tank.csv").write_text("\n".join(["t [s],u,y [m],q [V]", *rows]))
    (folder / "study.toml").write_text(STUDY.format(scales=scales))


@pytest.mark.parametrize(
    ("scales", "first", "last"),
    [
        ("", GUESSED + "; q", "estimated from the residuals in"),
        ("[scales]\nq = 1.5", GUESSED + "; q 1.5 V (given)", "q 1.5 V (given)"),
        pytest.param(
            "[scales]\ny = 0.5\nq = 1.5", "y 0.5 m (given); q 1.5 V (given)", "y 0.5 m (given), q 1.5 V (given)",
            marks=pytest.mark.slow,  # one output of the case above is given, too
        ),
    ],
)  # fmt: skip
@pytest.mark.thorough
def test_weights_are_told_before_and_after(tmp_path, monkeypatch, capsys, scales, first, last):
    tank(tmp_path, scales)
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "check", "study.toml", "--json")
    rows = {row["output"]: row for row in json.loads(said.out)["weights"]}
    said = call(capsys, monkeypatch, "check", "study.toml")
    assert f"residuals that count as 1: {first.format(format(rows['y']['scale'], '.4g'))}" in " ".join(said.out.split())
    said = call(capsys, monkeypatch, "run", "study.toml", "--no-diagnose")
    assert said.code == 0, said.err
    assert last in said.out
    assert "2 of 2 runs agree" in said.out
    assert last.split(" (")[-1].strip(")") in (tmp_path / "tank.html").read_text()
    findings = json.loads(call(capsys, monkeypatch, "report", "1", "--json").out)
    for row in findings["weights"]:
        given = row["output"] in scales
        assert row["chosen"] == ("given" if given else "residuals")
        if given:
            assert row["scale"] == rows[row["output"]]["scale"]


def test_check_tells_what_least_squares_solves_for(tmp_path, monkeypatch, capsys):
    """The outputs are linear in K and, given K, not in g: the product K g h is nonlinear in both together."""
    tank(tmp_path, "")
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "check", "study.toml", "--json")
    assert json.loads(said.out)["solved_for"] == ["K"]
    assert "linear, so that least squares solves for them: K" in call(capsys, monkeypatch, "check", "study.toml").out
    text = (tmp_path / "study.toml").read_text().replace("q = g*h", "q = g*h^2").replace("y = h\n", "y = exp(h)\n")
    (tmp_path / "study.toml").write_text(text)
    assert json.loads(call(capsys, monkeypatch, "check", "study.toml", "--json").out)["solved_for"] == ["g"]


@pytest.mark.parametrize(
    ("unit", "told"), [("1", "y 1 (the only"), ("-", "y 1 (the only"), ("", "y 1 (the only"), ("m", "y 1 m (the only")]
)
@pytest.mark.further(3)
def test_a_weight_without_unit_is_one_number(tmp_path, monkeypatch, capsys, unit, told):
    tank(tmp_path, "")
    monkeypatch.chdir(tmp_path)
    text = (tmp_path / "study.toml").read_text().replace('y = "m", q = "V"', f'y = "{unit}"').replace("q = g*h\n", "")
    text = (
        text.replace('y = "y [m]", q = "q [V]"', 'y = "y"')
        .replace("g = { bounds = [0.1, 10.0] }\n", "")
        .replace('unit = "m", ', "")
    )
    (tmp_path / "study.toml").write_text(text)
    rows = (tmp_path / "tank.csv").read_text()
    (tmp_path / "tank.csv").write_text(rows.replace("y [m]", "y"))
    said = call(capsys, monkeypatch, "check", "study.toml")
    assert said.code == 0, said.err
    assert f"residuals that count as 1: {told}" in " ".join(said.out.split())
