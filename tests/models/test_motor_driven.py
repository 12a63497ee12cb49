"""A mechanism behind a motor: a flywheel is the library's motor, a gear keeps the power."""

import numpy as np
import pytest

from plantfit.errors import ModelError
from plantfit.models.library.dc_motor import dc_motor
from plantfit.models.parts.motor_driven import motor_driven
from plantfit.models.text.equations import equations

P = {"Rm": 2.8, "Lm": 0.045, "Kb": 0.05, "Kt": 0.06, "Jm": 2e-3, "Cm": 1e-3, "Tf": 0.0}


def flywheel():
    return equations(
        "w' = (tau - Cm*w)/Jm", inputs={"tau": "N*m"}, states={"w": "rad/s"}, outputs={"w": "rad/s"},
        parameters={"Jm": {"unit": "kg*m^2", "bounds": (1e-4, 1.0)}, "Cm": {"unit": "N*m*s/rad", "bounds": (0.0, 1.0)}},
        name="flywheel",
    )  # fmt: skip


def rates(model, x, volts):
    return {n: float(v) for n, v in model.derivative(x, {"V": volts, "t": 0.0}, P).items()}


def test_a_flywheel_behind_a_motor_is_the_librarys_motor():
    driven = motor_driven(flywheel(), "tau", "w")
    for seed in range(5):
        i, w, volts = np.random.default_rng(seed).normal(size=3) * [2.0, 30.0, 8.0]
        ours, theirs = rates(driven, {"i": i, "w": w}, volts), rates(dc_motor(), {"i": i, "w": w}, volts)
        assert ours == pytest.approx(theirs, rel=1e-12)
    assert driven.inputs == {"V": "V"}
    assert driven.initial_state is None or driven.initial_state(P, {"V": 0.0}, {"w": 3.0})["i"] == 0.0


def test_a_gear_trades_speed_for_torque_and_keeps_the_power():
    gear, i, w, volts = 5.0, 1.3, 7.0, 4.0
    got = rates(motor_driven(flywheel(), "tau", "w", gear), {"i": i, "w": w}, volts)
    assert got["w"] == pytest.approx((gear * P["Kt"] * i - P["Cm"] * w) / P["Jm"])
    electric = volts * i - P["Rm"] * i**2 - P["Lm"] * i * got["i"]  # of the back-EMF
    assert electric == pytest.approx(P["Kb"] / P["Kt"] * gear * P["Kt"] * i * w)


def test_names_that_do_not_fit_are_refused():
    with pytest.raises(ModelError, match="name one of each"):
        motor_driven(flywheel(), "torque", "w")
    with pytest.raises(ModelError, match="already has 'Kb'"):
        motor_driven(motor_driven(flywheel(), "tau", "w"), "V", "w")
