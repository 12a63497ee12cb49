"""The closed form of the static curve against the simulation of the same study file."""

import numpy as np
import pytest

from plantfit.cases.gearmotor.steady import steady_speed
from plantfit.cases.shared.files import unpack
from plantfit.models.model import Model
from plantfit.simulate import Simulator
from plantfit.spec import load

VALUES = {"strength": 4400.0, "top_speed": 950.0, "threshold": 0.31, "viscous": 0.5, "dead_time": 0.01}


@pytest.mark.parametrize("u", [0.36, 0.5, 1.0, 5.0, -0.4, -3.0])
def test_settles_where_the_closed_form_says(tmp_path, u):
    model = load(unpack("gearmotor", tmp_path) / "gearmotor.toml").problem.model
    assert isinstance(model, Model)
    simulator = Simulator.of(model, substeps=2)
    t = np.arange(0.0, 12.0, 0.01)
    drive = simulator.drive(t, {"u": np.full(len(t), u)}, measured={"y": np.zeros(len(t))})
    settled = float(np.asarray(simulator.outputs(VALUES, drive)["y"])[-1])
    assert settled == pytest.approx(float(steady_speed(np.array([u]), VALUES)[0]), rel=1e-6)


def test_rests_inside_the_dead_zone_and_is_odd():
    u = np.linspace(-0.31, 0.31, 21)
    assert np.all(steady_speed(u, VALUES) == 0.0)
    u = np.linspace(0.0, 5.0, 50)
    assert np.array_equal(steady_speed(-u, VALUES), -steady_speed(u, VALUES))
    assert np.all(np.diff(steady_speed(u, VALUES)) >= 0)
