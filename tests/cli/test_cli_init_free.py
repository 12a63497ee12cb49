"""`plantfit init` of motions that no input drives."""

import tomllib

import numpy as np
import pytest
from cli_call import call

from plantfit.cli.commands.begin.free_motion import motion_of


def _written(tmp_path, monkeypatch, header, *columns):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "free.csv").write_text(
        header + "\n" + "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in zip(*columns, strict=True))
    )


@pytest.mark.parametrize(("unit", "factor"), [("deg", 180 / np.pi), pytest.param("rad", 1.0, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_pendulum_that_was_let_go_is_fitted_at_large_angles(tmp_path, monkeypatch, capsys, unit, factor):
    t, x, v = 0.02 * np.arange(600), [1.1], 0.0
    for _ in range(599 * 50):  # symplectic Euler at 0.4 ms
        v += 4e-4 * (-9.81 / 0.42 * np.sin(x[-1]) - 0.12 * v)
        x.append(x[-1] + 4e-4 * v)
    y = factor * (np.array(x[::50]) + 0.004 * np.random.default_rng(1).standard_normal(600))
    _written(tmp_path, monkeypatch, f"Time(ms),angle [{unit}]", 1000 * t, y)
    said = call(capsys, monkeypatch, "init", "free.csv", "--yes")
    assert said.code == 0, said.err
    assert "nothing drives it" in said.out
    assert "(a damped oscillation)" in said.out
    found = tomllib.loads((tmp_path / "free.toml").read_text())
    assert "sin(x - rest)" in found["model"]["equations"]
    ran = call(capsys, monkeypatch, "run", "free.toml")
    assert "w0 = 4.83" in ran.out  # sqrt(9.81 / 0.42) = 4.833
    assert "it holds" in ran.out
    assert "are white" in ran.out


@pytest.mark.thorough
def test_the_acceleration_of_a_phone_on_a_spring_among_others(tmp_path, monkeypatch, capsys):
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(1500)
    a = 9.79 + 1.8 * np.exp(-0.087 * t) * np.cos(5.491 * t + 0.4)
    noise = 0.03 * rng.standard_normal((3, len(t)))
    _written(tmp_path, monkeypatch, "Time (s),ax (m/s^2),az (m/s^2),absolute (m/s^2)",
             t, 0.1 + noise[0], a + noise[1], a + noise[2])  # fmt: skip
    said = call(capsys, monkeypatch, "init", "free.csv", "--yes")
    assert "Then --input none." in " ".join(said.out.split())
    several = call(capsys, monkeypatch, "init", "free.csv", "--yes", "--force", "--input", "none")
    assert several.code == 3
    assert "name it with --output, one of ['ax (m/s^2)', 'az (m/s^2)'" in " ".join(several.err.split())
    said = call(capsys, monkeypatch, "init", "free.csv", "--force", "--input", "none", "--output", "az")
    assert said.code == 0, said.err
    ran = call(capsys, monkeypatch, "run", "free.toml")
    assert "The data determine 5 of 5 parameters: w0 = 5.49" in ran.out
    assert "are white" in ran.out


@pytest.mark.thorough
def test_a_cup_that_cools_decays(tmp_path, monkeypatch, capsys):
    t = 5.0 * np.arange(300)
    y = 22 + 55 * np.exp(-t / 410) + 0.08 * np.random.default_rng(3).standard_normal(300)
    _written(tmp_path, monkeypatch, "t,T [degC]", t, y)
    said = call(capsys, monkeypatch, "init", "free.csv", "--yes")
    assert "(an exponential decay)" in said.out
    ran = call(capsys, monkeypatch, "run", "free.toml")
    assert "The data determine 3 of 3 parameters: tau = 4" in ran.out
    for command in ("tune", "design", "look"):
        refused = call(capsys, monkeypatch, command, "free.toml")
        assert "has no input" in " ".join(refused.err.split()), command
        assert "error inside plantfit" not in refused.err
    refused = call(capsys, monkeypatch, "init", "free.csv", "--yes", "--force", "--candidates")
    assert refused.code == 7
    assert "a motion without" in " ".join(refused.err.split())
    made = call(capsys, monkeypatch, "init", "free.csv", "--yes", "--force", "--json")
    assert '"input": null' in made.out


def test_a_column_that_never_changes_may_be_a_dead_sensor(tmp_path, monkeypatch, capsys):
    t = 0.1 * np.arange(100)
    _written(tmp_path, monkeypatch, "t,angle,u", t, np.cos(4 * t), 0 * t)
    said = call(capsys, monkeypatch, "init", "free.csv", "--yes")
    assert said.code == 3
    assert "only 'angle' changes. If nothing drives the plant, give --input none." in " ".join(said.err.split())
    assert call(capsys, monkeypatch, "init", "free.csv", "--input", "none").code == 0


@pytest.mark.parametrize("word", [("ON", "OFF"), ("0xFF", "0x1A"), ("true", "false")])
def test_an_input_in_words_is_no_free_motion(tmp_path, monkeypatch, capsys, word):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{k};{word[k // 20 % 2]};{20 + k % 20}\n" for k in range(120))
    (tmp_path / "w.csv").write_text(f"t;heater;T\n{rows}")
    said = call(capsys, monkeypatch, "init", "w.csv", "--yes")
    assert said.code == 3
    assert "Not made of numbers: 'heater'" in " ".join(said.err.split())


def test_of_two_clocks_the_one_counts_whose_times_are_not_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"2026-03-02,12:00:{k // 20:02d},{50 * k},{20 + 50 * 2.7183 ** (-k / 90):.2f}\n" for k in range(600))
    (tmp_path / "c.csv").write_text(f"Date,Time,millis,T\n{rows}")
    said = call(capsys, monkeypatch, "init", "c.csv", "--yes")
    assert said.code == 0, said.err
    assert "appears twice" not in said.out
    assert "(an exponential decay)" in said.out
    assert "600 samples over 29.95 s" in call(capsys, monkeypatch, "check", "c.toml").out


def test_oscillations_and_decays_are_told_apart():
    rng = np.random.default_rng(4)
    for _ in range(60):
        n, cycles = int(rng.integers(100, 3000)), rng.uniform(3, 25)
        t = np.linspace(0, 1, n)
        swing = np.exp(-rng.uniform(0, 6) * t) * np.cos(2 * np.pi * cycles * t + rng.uniform(0, 6)) + rng.uniform(-2, 2)
        motion, found = motion_of(swing + 0.01 * rng.standard_normal(n))
        assert motion == "oscillation"
        assert abs(found - cycles) < 0.34 * cycles + 0.5
        decay = np.exp(-rng.uniform(0.3, 20) * t) * rng.choice([-1, 1]) + rng.uniform(-2, 2)
        assert motion_of(decay + 0.02 * rng.uniform() * rng.standard_normal(n))[0] == "decay"
    assert motion_of(np.r_[np.nan, np.ones(5)])[0] == "decay"


@pytest.mark.thorough
def test_milliseconds_and_microseconds_alone_in_a_header_are_time(tmp_path, monkeypatch, capsys):
    rng = np.random.default_rng(5)
    t = np.arange(400)
    for header in ("ms", "us", "usec", "Millisekunden"):
        _written(tmp_path, monkeypatch, f"{header},A0", 5000 * t, 1000 * np.exp(-t / 90) + rng.normal(0, 1, 400))
        said = call(capsys, monkeypatch, "init", "free.csv", "--yes", "--force")
        assert f"  {header}  time" in " ".join(said.out.split(",")[1:]), said.out
        assert "an exponential decay" in said.out
    _written(tmp_path, monkeypatch, "t,us,y", 0.1 * t, 1.0 + t // 40 % 2, np.sin(t / 40))  # a voltage
    assert "us input" in " ".join(call(capsys, monkeypatch, "init", "free.csv", "--yes", "--force").out.split())
