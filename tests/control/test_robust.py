"""Steps judged over families of plants, and controllers tuned on them, against plain numpy, a linear program and a
grid."""

import numpy as np
import pytest
from scipy.optimize import linprog

import plantfit.runtime  # noqa: F401
from plantfit.control import (
    Demand,
    Gains,
    StepProfile,
    StepScores,
    judged,
    pid,
    profile_scores,
    robust_tuning,
    stacked_controllers,
    step_metrics,
)
from plantfit.errors import SearchError, SimulationError
from plantfit.models.text.equations import equations
from plantfit.simulate.loop.closed_loop import closed_loop
from plantfit.space import Parameter

PERIOD = 0.1
PROFILE = StepProfile((0.0, 8.0, 14.0), (1.0, 3.0, 2.0), 20.0, band=0.05)
PLANTS = {"K": np.array([2.0, 2.4, 1.5]), "tau": np.array([3.0, 2.0, 3.5]), "Td": np.array([0.3, 0.55, 0.42])}
LAG = equations(
    "y' = (K*delay(u, Td) - y)/tau\nz = y",
    inputs=["u"],
    states=["y"],
    outputs=["z"],
    parameters=["K", "tau", "Td"],
    name="lag",
)


def loop():
    return closed_loop(LAG, pid(PERIOD, lower=0.0, upper=4.0), period=PERIOD, longest_delay=1.0)


def plant(i):
    return {name: values[i] for name, values in PLANTS.items()}


@pytest.mark.thorough
def test_scores_of_every_step_are_those_of_its_own_stored_response():
    gains = [Gains(1.0, 0.4), Gains(2.5, 1.0)]
    scores = judged(loop(), stacked_controllers(gains), PLANTS, PROFILE)
    assert np.shape(scores.iae) == (2, 3, 3)
    for c, g in enumerate(gains):
        for i in range(3):
            seen = loop().simulate(g, plant(i), PROFILE.reference(PERIOD))
            t, y, u = (np.asarray(v) for v in (seen.t, seen.y, seen.u))
            stored = profile_scores(PROFILE, t, y, u)
            np.testing.assert_allclose(np.array(stored), np.array([v[c, i] for v in scores]), rtol=1e-9)
            for s, (begin, end, level) in enumerate(((0, 80, 1.0), (80, 140, 3.0), (140, 200, 2.0))):
                own = step_metrics(t[begin:end], y[begin:end], level, band=0.05)
                size = abs(level - y[begin])
                assert scores.overshoot[c, i, s] == pytest.approx(own.overshoot, abs=1e-9)
                assert scores.settling[c, i, s] == pytest.approx(own.settling_time, abs=1e-9)
                assert scores.iae[c, i, s] == pytest.approx(
                    PERIOD * np.sum(np.abs(level - y[begin + 1 : end])) / size, rel=1e-9
                )
                first = max(begin, 1)
                assert scores.travel[c, i, s] == pytest.approx(np.sum(np.abs(np.diff(u[first - 1 : end]))), rel=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.35, 0.8, 1.0])
def test_value_at_risk_is_the_least_of_its_linear_program(share):
    """min over t of t + E[(c - t)+]/share: Rockafellar and Uryasev, eq. (9); the worst case for a share below one
    member."""
    costs = np.random.default_rng(2).gamma(2.0, size=9)
    used = max(share, 1 / 9)
    found = linprog(
        np.r_[1.0, np.full(9, 1 / (9 * used))],
        A_ub=np.c_[-np.ones(9), -np.eye(9)],
        b_ub=-costs,
        bounds=[(None, None)] + [(0, None)] * 9,
    )
    assert float(Demand(share=share).over_plants(costs)) == pytest.approx(found.fun, rel=1e-9)
    assert float(Demand(share=share, mean=0.3).over_plants(costs)) == pytest.approx(
        0.7 * found.fun + 0.3 * costs.mean(), rel=1e-9
    )
    assert np.isinf(float(Demand(share=share).over_plants(np.r_[costs, np.inf])))


def test_limits_cost_as_much_as_is_said():
    scores = StepScores(np.array([2.0, 4.0]), np.array([1.0, 12.0]), np.array([3.0, 3.0]), np.array([5.0, 60.0]))
    assert float(Demand().of_plant(scores)) == 3.0
    assert float(Demand(overshoot=10.0).of_plant(scores)) == pytest.approx(3.0 * (1 + 10 * 0.2))
    assert float(Demand(overshoot=10.0, travel=40.0).of_plant(scores)) == pytest.approx(3.0 * 3.0 * 6.0)
    assert float(Demand(overshoot=12.0, travel=60.0).of_plant(scores)) == 3.0
    assert np.isinf(float(Demand(overshoot=5.0).of_plant(scores._replace(iae=np.array([1.0, np.nan])))))


@pytest.mark.thorough
def test_tuning_on_a_family_finds_the_least_worst_case_of_a_grid():
    """One gain: the worst of three plants over a grid of three hundred, each loop simulated alone by the plain
    engine."""
    demand = Demand(overshoot=5.0)

    def make(Kp):
        return Gains(Kp, 0.3)

    bounds = {"Kp": Parameter((0.05, 20.0), scale="log")}
    found = robust_tuning(loop(), PLANTS, PROFILE, bounds, make, demand, budget=100, seed=2)
    grid = np.geomspace(0.05, 20.0, 300)
    scores = judged(loop(), stacked_controllers([make(v) for v in grid]), PLANTS, PROFILE)
    beyond = [[max(np.max(scores.overshoot[c, i]) - 5, 0) / 5 for i in range(3)] for c in range(300)]
    costs = np.array([[np.mean(scores.iae[c, i]) * (1 + 10 * beyond[c][i]) for i in range(3)] for c in range(300)])
    worst = costs.max(axis=1)
    assert found.cost <= worst.min() * 1.001
    assert found.values["Kp"] == pytest.approx(grid[worst.argmin()], rel=0.05)
    assert worst[costs[:, 0].argmin()] > 1.3 * found.cost  # the best gain of the first plant alone


@pytest.mark.thorough
def test_bad_input_is_named():
    several = closed_loop(LAG, pid(PERIOD), period=PERIOD, output=["z"], input=["u"], longest_delay=1.0)
    for error, said, call in (
        (SimulationError, "times that increase from 0", lambda: StepProfile((0.0, 5.0), (1.0, 2.0), 4.0)),
        (SimulationError, "a level for each time", lambda: StepProfile((0.0, 5.0), (1.0,), 9.0)),
        (SimulationError, "band = 2", lambda: StepProfile((0.0,), (1.0,), 9.0, band=2)),
        (SimulationError, "share = 1.5", lambda: Demand(share=1.5)),
        (SimulationError, "overshoot = -1", lambda: Demand(overshoot=-1)),
        (SimulationError, "loops over one signal",
         lambda: judged(several, stacked_controllers([Gains(1.0)]), PLANTS, PROFILE)),
        (SearchError, "No controller within the bounds",
         lambda: robust_tuning(loop(), {**PLANTS, "tau": -0.01 * PLANTS["tau"]}, StepProfile((0.0,), (1.0,), 60.0),
                               {"Kp": Parameter((1.0, 2.0))}, Gains, method="sobol", budget=8)),
    ):  # fmt: skip
        with pytest.raises(error, match=said):
            call()
