"""Answers confirmed by an independent solver: the fit goes on finer where the cost is off, and refuses what nothing
can follow."""

import numpy as np
import pytest
from benchmarks.confirmed import answers_of, row_of

import plantfit as pf
from plantfit.errors import Status
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem, checked_cost
from plantfit.recording import from_arrays
from plantfit.trust.finish.final_problem import REFUSED, finish

T = np.array([0.0, 1.0, 2.0, 4.0, 7.0, 10.0])
NOISE = 0.01 * np.random.default_rng(1).standard_normal(len(T))


def ended(z, cost, number=0):
    none = np.zeros(0)
    return RunResult(
        "least_squares", number, 1, np.asarray(z, dtype=float), cost, 100.0, 0.0, Status.converged, none, none, 0, {}
    )


@pytest.mark.thorough
def test_a_fit_goes_on_with_finer_steps_until_the_cost_is_right():
    text = "y' = r*y*(1 - y)"
    model = pf.equations(
        text, states={"y": {"initial": 1e-4}}, outputs=["y"], parameters={"r": {"bounds": (0.5, 20.0), "scale": "log"}}
    )
    y = 1.0 / (1.0 + (1e4 - 1.0) * np.exp(-3.0 * T)) + NOISE
    coarse = Problem(model, from_arrays(T, signals={"y": y}, name="run"))
    coarse = coarse.with_simulator(coarse.predictor.stepping().refined(4))
    z = np.asarray(coarse.space.cube(np.array([3.0])))
    assert not checked_cost(coarse, z).confirmed
    problem, (run,) = finish(coarse, [ended(z, float(coarse.cost(z)))])
    assert checked_cost(problem, run.x).confirmed
    # the optimum of the closed form
    r = np.linspace(2.8, 3.2, 40001)[:, None]
    best = r[np.argmin(np.sum((1.0 / (1.0 + (1e4 - 1.0) * np.exp(-r * T)) - y) ** 2, axis=1)), 0]
    np.testing.assert_allclose(np.asarray(problem.space.physical(run.x)), best, rtol=1e-3)


def test_an_answer_behind_a_pole_is_refused_with_time_and_state():
    # x' = k x^2 from 1 has its pole at 1/k; steps of 1 s jump over it, and data are what they give there
    model = pf.equations(
        "x' = k*x^2\n y = x", states={"x": {"initial": 1.0}}, outputs=["y"], parameters={"k": {"bounds": (0.01, 5.0)}}
    )
    y = Problem(model, from_arrays(T, signals={"y": T}, name="run"), substeps=1).predict(np.array([4.0]))["y"]
    problem = Problem(model, from_arrays(T, signals={"y": y + 1e-3 * NOISE}, name="run"), substeps=1)
    behind = np.asarray(problem.space.cube(np.array([4.0])))
    _, (run,) = finish(problem, [ended(behind, float(problem.cost(behind)))])
    assert run.extra["ended"] == REFUSED
    assert "in recording run, at t = 0.2" in run.extra["refused"]
    assert "state x" in run.extra["refused"]
    assert np.isfinite(run.cost)  # nothing else is left to report: the verdict says that it is refused


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pendulum", "limit cycle", "late tank", "hunter and prey", "heater", "thermal"])
def test_demos_and_problems_of_the_suite_report_the_cost_of_the_tight_solver(name):
    rows = [row_of(n, answer) for n, answer in answers_of(name, 0)]
    assert all(row["followed"] and row["off"] <= 0.01 and not row["said"] for row in rows), rows


@pytest.mark.slow
def test_a_cost_that_fixed_steps_leave_wrong_is_said_to_be():
    [row] = [row_of(n, answer) for n, answer in answers_of("soft shaft", 0)]
    assert row["off"] > 0.01
    assert "would need finer steps than were chosen" in row["said"][0]
