"""Inputs that were measured with noise: it is seen where an input goes from level to level, and intervals allow for
it."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.errors import RecordingError
from plantfit.optimize import minimise
from plantfit.problem import Experiment
from plantfit.recording.looks.noisy import reading_noise
from plantfit.spec import load
from plantfit.study.objective import objective_of
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.misreadings import allowing_for_misreadings, moves
from plantfit.trust.intervals.parameter_rows import parameter_rows
from plantfit.trust.intervals.ranges import Range
from plantfit.trust.looks.misreadings import misreading_looks, misreadings, telling
from plantfit.trust.verdict.misreadings import misreading_sentences

N, CAPACITY, NOISE = 1200, 500.0, 0.04
KINDS = {"rounded": "u", "noisy": "i"}
CELL = equations(
    "s' = -i/Q\nv = 3.0 + s",
    inputs={"i": "A"},
    states={"s": {"unit": "", "initial": "s0"}},
    outputs={"v": ""},
    parameters={"Q": "A*s", "s0": ""},
)
SPACE = {"Q": Parameter((100.0, 5000.0), "A*s"), "s0": Parameter((0.0, 2.0), "")}


def levels(draw, n=N, stays=10, size=1.0):
    return np.repeat(np.round(size * draw.normal(size=n // stays + 1), 2), stays)[:n]


def drive(seed, noise=NOISE, **errors):
    """A cell whose charge is counted from its current, in blocks of 10 s about 0.2 A, measured with noise."""
    draw, t = np.random.default_rng(seed), np.arange(float(N))
    i = 0.2 + levels(draw, size=2.0)
    s = 0.8 - np.r_[0.0, np.cumsum(i[:-1])] / CAPACITY
    signals = {
        "i": Signal(i + noise * draw.normal(size=N), "A"),
        "v": Signal(3.0 + s + 1e-3 * draw.normal(size=N), None),
    }
    return Experiment(Recording(t, signals, "cell"), **errors)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 400.0])
@pytest.mark.parametrize("stays", [6, 10, 60])
def test_noise_on_levels_is_measured(scale, stays):
    draw = np.random.default_rng(stays)
    for size in (0.002, 0.02):
        y = scale * (7.0 + levels(draw, 2400, stays) + size * draw.normal(size=2400))
        assert reading_noise(y) == pytest.approx(scale * size, rel=0.1)


def others(draw):
    t = np.arange(2000.0)
    walk, slow = np.cumsum(draw.normal(size=2000)), np.convolve(draw.normal(size=2040), np.ones(41) / 41, "valid")
    return {
        "a command of levels": levels(draw, 2000),
        "a PRBS": np.sign(levels(draw, 2000, 7)),
        "a sine": np.sin(0.07 * t),
        "a sine with noise": np.sin(0.07 * t) + 0.01 * draw.normal(size=2000),
        "a ramp": 0.01 * t,
        "a random walk": walk,
        "white noise": draw.normal(size=2000),
        "one level with noise": 5.0 + 0.01 * draw.normal(size=2000),
        "levels with large noise": levels(draw, 2000) + 0.5 * draw.normal(size=2000),
        "levels that wander": levels(draw, 2000, 50) + 0.05 * slow,
        "nothing": np.zeros(2000),
        "few samples": draw.normal(size=8),
    }


@pytest.mark.parametrize("name", others(np.random.default_rng(0)))
def test_other_signals_have_no_noise_of_readings(name):
    for seed in range(5):
        assert reading_noise(others(np.random.default_rng(seed))[name]) is None


@pytest.mark.parametrize("count", [25, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_intervals_hold_where_those_by_the_outputs_noise_do_not(count):
    base, held = Problem(CELL, drive(0), SPACE), {"output": 0, "both": 0}
    seeds, found, told = range(1, count + 1), [], []
    for seed in seeds:
        problem = base.with_recordings({"cell": drive(seed).recording})
        start = problem.space.cube(problem.space.vector({"Q": CAPACITY, "s0": 0.8}))
        z = minimise(objective_of(problem, start[None, :]), "least_squares", budget=300, settings={"agree": 1})[0].x
        local = linearise(problem, z)
        ends = {
            k: Range(v - 1.96 * e, v + 1.96 * e)
            for k, (v, e) in enumerate(zip(local.values, local.standard_error, strict=True))
        }
        rows, looks = allowing_for_misreadings(problem, z, local, parameter_rows(problem.space, local, set(), ends))
        held["output"] += abs(local.values[0] - CAPACITY) < 1.96 * local.standard_error[0]
        held["both"] += rows[0]["low"] < CAPACITY < rows[0]["high"]
        assert [look.kind for look in looks] == ["noisy"]
        found.append(local.values[0] - CAPACITY)
        told.append(moves(problem, z, local, misreadings(problem)).values[0])
    assert held["output"] < 0.5 * len(seeds), held
    assert held["both"] >= 0.9 * len(seeds), held
    assert np.sqrt(np.mean(np.square(told))) < 1.4 * np.std(found)


@pytest.mark.thorough
def test_what_looks_like_noise_and_was_there_widens_nothing():
    """The current really shook: residuals show nothing of it."""
    for seed in range(1, 6):
        draw, t = np.random.default_rng(seed), np.arange(float(N))
        i = 0.2 + levels(draw, size=2.0) + NOISE * draw.normal(size=N)
        s = 0.8 - np.r_[0.0, np.cumsum(i[:-1])] / CAPACITY
        signals = {"i": Signal(i, "A"), "v": Signal(3.0 + s + 1e-3 * draw.normal(size=N), None)}
        problem = Problem(CELL, Experiment(Recording(t, signals, "cell")), SPACE)
        assert [s.kind for s in misreadings(problem)] == ["noisy"]
        found = fit(problem, budget=600).findings
        assert found["parameters"][0]["by_steps"] is None
        assert not any("noise (i)" in v["sentence"] for v in found["verdict"])


def test_the_verdict_names_the_noise_and_the_line_that_says_there_is_none():
    answer = fit(Problem(CELL, drive(3), SPACE), budget=600)
    own = next(v["sentence"] for v in answer.findings["verdict"] if "readings with noise (i)" in v["sentence"])
    assert "only quieter readings narrow the interval" in own
    assert "write noisy = { i = 0 } under [recording.cell]" in own
    assert answer.findings["parameters"][0]["by_steps"] > 0
    exact = fit(Problem(CELL, drive(3, noisy={"i": 0.0}), SPACE), budget=600)
    assert not any("noise (i)" in v["sentence"] for v in exact.findings["verdict"])
    assert exact.findings["parameters"][0]["by_steps"] is None


LAG = equations(
    "x' = (K*u - x)/tau\ny = x",
    inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"], parameters={"K": "1", "tau": "s"},
)  # fmt: skip


@pytest.mark.parametrize(("noise", "there", "said"), [(0.02, 1e-3, True), (0.02, 0.5, False), (0.0, 1e-3, False)])
def test_a_check_speaks_of_noise_by_that_of_the_output(noise, there, said):
    draw, t = np.random.default_rng(2), 0.1 * np.arange(float(N))
    u, y = levels(draw, stays=20), np.zeros(N)
    for k in range(N - 1):
        y[k + 1] = y[k] + (2.0 * u[k] - y[k]) * (1.0 - np.exp(-0.1 / 0.5))
    signals = {"u": Signal(u + noise * draw.normal(size=N)), "y": Signal(y + there * draw.normal(size=N))}
    problem = Problem(LAG, Recording(t, signals, "a"), {"K": Parameter((0.1, 9)), "tau": Parameter((0.1, 9), "s")})
    looks = misreading_looks(problem, telling(problem, misreadings(problem)))
    assert [look.kind for look in looks] == ["noisy"] * said
    for look in looks:
        assert "u was read with noise of 0.02" in look.sentence
        assert "If the plant got what is recorded, write noisy = { u = 0 }." in look.sentence


def test_errors_of_several_kinds_are_told_together():
    rows = [{"name": "Q", "by_steps": 3.0, "standard_error": 3.5, "value": 500.0, "low": 493.0, "high": 507.0,
             "unit": "A*s"}]  # fmt: skip
    figures = {"steps": 40.0, "steps_a_sample": 3.0, "left": 0.3, "told": 1}
    looks = [{"kind": kind, "signal": u, "recording": "a", "figures": figures} for kind, u in KINDS.items()]
    for some, better in ((KINDS, "finer steps and quieter readings"), (("noisy",), "quieter readings")):
        (said,) = misreading_sentences({"parameters": rows, "data": [k for k in looks if k["kind"] in some]})
        assert f"only {better} narrow the interval" in said["sentence"]
        assert ("readings in steps (u)" in said["sentence"]) == (len(some) > 1)
        assert "readings with noise (i), 2.5 % of their range" in said["sentence"]
    assert not list(misreading_sentences({"parameters": rows, "data": []}))
    assert not list(misreading_sentences({"parameters": [rows[0] | {"by_steps": None}], "data": looks}))


def test_what_is_told_counts_in_place_of_what_is_seen_in_the_units_of_the_model():
    (seen,) = misreadings(Problem(CELL, drive(1), SPACE))
    assert (seen.kind, seen.told) == ("noisy", False)
    assert seen.size == pytest.approx(NOISE, rel=0.1)
    e = drive(1)
    milli = Recording(e.recording.t, {"i": Signal(1e3 * e.recording["i"], "mA"), "v": e.recording.signals["v"]}, "cell")
    (told,) = misreadings(Problem(CELL, Experiment(milli, noisy={"i": 250.0}), SPACE))
    assert (told.kind, told.size, told.told) == ("noisy", pytest.approx(0.25), True)
    assert misreadings(Problem(CELL, drive(1, rounded={"i": 0.0}), SPACE)) == []


def test_noise_that_cannot_be_is_refused():
    with pytest.raises(RecordingError, match="noisy names 'j'"):
        drive(1, noisy={"j": 0.1})
    with pytest.raises(RecordingError, match="noise of -1; give its standard deviation, or 0 for none"):
        drive(1, noisy={"i": -1.0})
    with pytest.raises(RecordingError, match=r"noise of 1e\+06, but it moves by .*; give its standard deviation"):
        drive(1, noisy={"i": 1e6})


def test_a_study_file_states_it(tmp_path):
    e = drive(1)
    np.savetxt(
        tmp_path / "cell.csv", np.column_stack([e.recording.t, e.recording["i"], e.recording["v"]]),
        delimiter=",", header="t [s],i [A],v", comments="",
    )  # fmt: skip
    (tmp_path / "cell.toml").write_text("""
name = "cell"
[recording.cell]
file = "cell.csv"
time = "t [s]"
noisy = { i = 0.3 }
[model]
equations = "s' = -i/Q; v = 3.0 + s"
inputs = { i = "A" }
states = { s = { unit = "", initial = "s0" } }
outputs = ["v"]
[parameters]
Q = { unit = "A*s", bounds = [100, 5000] }
s0 = { unit = "", bounds = [0, 2] }
""")
    assert [(s.size, s.told) for s in misreadings(load(tmp_path / "cell.toml").problem)] == [(0.3, True)]
