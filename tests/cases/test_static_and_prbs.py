"""One model for the PRBS and the static curve of the geared motor: recordings, steady states, weights."""

import numpy as np
import pytest

from plantfit.cases.gearmotor.steady import steady_speed
from plantfit.cases.shared.files import unpack
from plantfit.spec import load

VALUES = {"strength": 4560.0, "top_speed": 800.0, "threshold": 0.3155, "viscous": 0.075, "dead_time": 0.011}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return load(unpack("gearmotor", tmp_path_factory.mktemp("gearmotor")) / "static_and_prbs.toml").problem


def test_only_the_first_half_and_the_static_curve_are_fitted(problem):
    scored = {name: {o: len(i) for o, i in row.items()} for name, row in problem.data["index"].items()}
    assert scored == {"prbs": {"y": 2046, "settled": 0}, "curve": {"y": 0, "settled": 100}}
    assert problem.data["index"]["prbs"]["y"].max() < 2047


def test_settled_speed_is_the_closed_form_up_to_the_creep_in_the_dead_zone(problem):
    x = problem.space.vector(VALUES)
    u = problem.experiments["curve"].recording["u"]
    expected = steady_speed(u, VALUES)
    settled = problem.predict(x, "curve")["settled"]
    moving = np.abs(expected) > 60.0  # where tanh(w / creep) is 1
    assert settled[moving] == pytest.approx(expected[moving], rel=1e-9)
    assert np.all(np.abs(settled[expected == 0.0]) < 20.0)  # tanh creeps there, a few times `creep`


def test_residuals_are_those_of_the_two_records_over_their_scales(problem):
    x = problem.space.vector(VALUES)
    r = np.asarray(problem.residuals(problem.space.cube(x)))
    prbs, curve = problem.experiments["prbs"].recording, problem.experiments["curve"].recording
    moving = (problem.predict(x, "prbs")["y"] - prbs["y"])[:2046] / problem.scales["y"]
    steady = (problem.predict(x, "curve")["settled"] - curve["settled"]) / problem.scales["settled"]
    assert r == pytest.approx(np.concatenate([moving, steady]), abs=1e-9)
