"""Which hold fits, with its power; inputs recorded by another clock."""

from functools import cache

import numpy as np
import pytest

import plantfit as pf
from plantfit.errors import ModelError
from plantfit.problem import Problem
from plantfit.problem.measure.hold_check import _compared, _held, _refitted, check_holds
from plantfit.recording import from_arrays
from plantfit.simulate.steps.grid import Held

N, DT = 400, 0.2
T = DT * np.arange(N)
LAG = pf.equations("x' = (K*u - x)/tau\ny = x", inputs=["u"], states=["x"], outputs=["y"], check=False,
                   parameters={"K": {"bounds": (0.5, 4.0)}, "tau": {"bounds": (0.1, 5.0), "unit": "s"}})  # fmt: skip
TRUTH = np.array([2.0, 0.6])
Z = np.array([0.3, 0.4])  # where the refits begin


@cache
def simulated(hold):
    """A problem of records of this length, whose programs all of them share."""
    return Problem(
        LAG, from_arrays(T, signals={"u": np.sin(T), "y": 0 * T}, name="run"), hold={"u": hold}, stepper="exact"
    )


@cache
def recorded(hold, noise, seed=0, corner=8):
    """A noisy first order under an input through `corner` samples between its random values."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(-1, 1, N // corner + 2)
    u = np.interp(np.arange(N) / corner, np.arange(len(knots)), knots) if corner > 1 else knots[:N]
    empty = from_arrays(T, signals={"u": u, "y": 0 * T}, name="run")
    y = simulated(hold).with_recordings({"run": empty}).predict(TRUTH)["y"]
    return from_arrays(T, signals={"u": u, "y": y + noise * rng.normal(size=N)}, name="run")


@cache
def both_holds(declared):
    problem = Problem(LAG, recorded("previous", 0.01), hold={"u": declared}, stepper="exact", substeps=1)
    return {kind: _held(problem, {"u": kind}) for kind in (Held.PREVIOUS, Held.LINEAR)}


def compared(record, declared):
    """`check_holds` of one record, with programs that all records share: compiled anew for each of them, 40 took a
    minute."""
    refitted = {kind: _refitted(p.with_recordings({"run": record}), Z) for kind, p in both_holds(declared).items()}
    return _compared("u", refitted[Held.PREVIOUS], refitted[Held.LINEAR])


@pytest.mark.parametrize("declared", ["previous", "linear"])
@pytest.mark.parametrize("truth", ["previous", "linear"])
@pytest.mark.further(3)
def test_the_hold_of_the_record_is_found_whatever_is_declared(truth, declared):
    problem = Problem(LAG, recorded(truth, 0.01), hold={"u": declared}, stepper="exact", substeps=1)
    (first,) = check_holds(problem, Z)
    assert first.standard_errors == pytest.approx(compared(recorded(truth, 0.01), declared).standard_errors, rel=1e-3)
    for found in (first, *(compared(recorded(truth, 0.01, seed), declared) for seed in range(1, 4))):
        assert found.better == truth
        assert found.power > 3
        assert f'hold = {{ u = "{truth}" }} fits better' in found.sentence


def test_nothing_is_said_where_noise_hides_the_difference():
    """Of 20 records with both holds far below the noise none may be told apart surely."""
    told = []
    for seed in range(20):
        found = compared(recorded(("previous", "linear")[seed % 2], 3.0, seed, corner=40), "previous")
        told.append(found.better)
        assert found.power < 3
        assert "cannot tell" in found.sentence
    assert told == [None] * 20


def test_an_input_that_rests_is_left_out():
    record = from_arrays(T, signals={"u": np.ones(N), "y": np.ones(N)}, name="run")
    assert check_holds(Problem(LAG, record, substeps=1), np.array([0.3, 0.4])) == []


@cache
def late_input():
    """An input u(t) and the outputs (n,) that it has at the samples."""
    rng = np.random.default_rng(3)
    fine = np.interp(
        np.arange(-5.0, 90.0, 0.7),
        np.arange(-5.0, 95.0, 1.4),
        rng.uniform(-1, 1, 72)[: len(np.arange(-5.0, 95.0, 1.4))],
    )

    def u(t):
        return np.interp(t, np.arange(-5.0, 90.0, 0.7), fine)

    long = DT / 20 * np.arange(20 * N)
    empty = from_arrays(long, signals={"u": u(long), "y": 0 * long})
    return u, Problem(LAG, empty, hold={"u": "linear"}, stepper="exact").predict(TRUTH)["y"][::20]


def shifted(by):
    """The input is written `by` seconds too early: it acts later than its time stamps say."""
    u, y = late_input()
    return from_arrays(T, signals={"u": u(T + by), "y": y}, name="run")


@cache
def with_free_clock():
    """A problem of records of this length, whose programs all of them share."""
    free = {"clock_shift_u": (-0.5, 0.4)}
    return Problem(LAG, shifted(0.13), free, hold={"u": "linear"}, clock_shift={"u": (-0.5, 0.5)}, skip=5.0)


@pytest.mark.parametrize("by", [pytest.param(0.13, marks=pytest.mark.slow), -0.21])
@pytest.mark.thorough
def test_a_shift_between_clocks_is_a_parameter_of_either_sign(by):
    answer = pf.fit(with_free_clock().with_recordings({"run": shifted(by)}), seed=1)
    assert answer.values["clock_shift_u"] == pytest.approx(by, abs=0.01)
    assert answer.values["tau"] == pytest.approx(0.6, rel=0.03)


def test_gradients_by_a_shift_are_those_of_the_cost():
    problem = with_free_clock()
    for shift in (-0.23, 0.22):
        z = problem.space.cube(np.array([1.9, 1.5, shift]))
        _, g = problem.value_and_gradient(z)
        for k in range(3):
            d = 1e-6 * np.eye(3)[k]
            assert g[k] == pytest.approx(float(problem.cost(z + d) - problem.cost(z - d)) / 2e-6, rel=1e-4, abs=1e-9)


def test_a_shift_that_cannot_be_known_is_refused():
    record = from_arrays(T, signals={"u": T, "y": T}, name="run")
    for shift, said in (
        ({"y": (-1, 1)}, "an output"),
        ({"w": (-1, 1)}, "no channel"),
        ({"u": (1, -1)}, "bounds of the shift"),
    ):
        with pytest.raises(ModelError, match=said):
            Problem(LAG, record, clock_shift=shift)
    late = pf.equations(
        "y = delay(u, L)", inputs=["u"], outputs=["y"], parameters={"L": {"unit": "s", "bounds": (0, 1)}}, check=False
    )
    with pytest.raises(ModelError, match="dead time already"):
        Problem(late, record, clock_shift={"u": (-0.1, 0.1)})


STUDY = """
name = "clocks"
[recording.run]
file = "run.csv"
[model]
equations = "x' = (K*u - x)/tau"
inputs = { u = "" }
states = { x = "" }
outputs = { x = "" }
clock_shift = { u = [-0.5, 0.5] }
[parameters.K]
bounds = [0.1, 9.0]
unit = ""
[parameters.tau]
bounds = [0.5, 20.0]
unit = "s"
[parameters.clock_shift_u]
bounds = [-0.3, 0.3]
"""


@pytest.mark.thorough
def test_a_study_file_frees_a_clock_and_check_tells_the_hold(tmp_path, monkeypatch, capsys):
    from typer.testing import CliRunner

    from plantfit.cli.main import app

    rng = np.random.default_rng(0)
    rows = "".join(f"{t},{u},{x}\n" for t, u, x in zip(T, rng.uniform(-1, 1, N), rng.normal(size=N), strict=True))
    (tmp_path / "run.csv").write_text("t,u,x\n" + rows)
    (tmp_path / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    said = CliRunner().invoke(app, ["check", "study.toml", "--holds"])
    assert said.exit_code == 0, said.output
    assert "clock_shift_u" in said.output
    assert "hold" in said.output.splitlines()[-3]
    assert "These records can" in said.output.splitlines()[-2]
