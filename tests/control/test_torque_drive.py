"""Torques through a motor's voltage: against the pendubot's own voltage drive, and what the clipped voltage gives."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.control import kalman_observer, linearised, lqr
from plantfit.control.linear.kalman import measured_states
from plantfit.control.linear.torque_drive import through_motor
from plantfit.errors import SimulationError
from plantfit.models.library.pendubot import pendubot

import jax.numpy as jnp

BASE = {"b1": 0.0058, "b2": 0.003, "b4": 0.04, "b5": 0.015}
MOTOR = {"Rm": 2.8, "Kt": 0.07, "Kb": 0.05}
UPRIGHT = {"theta1": np.pi / 2}


def design(limits=None):
    plant = linearised(pendubot("base"), BASE, UPRIGHT)
    observer = kalman_observer(plant, 1e-3, {"omega1": 0.3, "omega2": 0.3}, 1e-4)
    return lqr(plant, 1e-3, {"theta1": 1.0, "theta2": 1.0}, 1.0, estimator=observer, limits=limits)


def test_the_plant_by_voltage_is_the_models_own():
    ours = through_motor(design(), MOTOR, "omega1", 12.0).plant
    values = {**BASE, "kt": MOTOR["Kt"], "ke": MOTOR["Kb"], "Ra": MOTOR["Rm"]}
    theirs = linearised(pendubot("base", drive="voltage"), values, UPRIGHT)
    np.testing.assert_allclose(ours.A, theirs.A, atol=1e-12)
    np.testing.assert_allclose(ours.B, theirs.B, atol=1e-12)
    assert ours.inputs == ("V",)


@pytest.mark.parametrize("gear", [1.0, 3.0])
def test_a_voltage_gives_the_torque_that_was_asked_for(gear):
    plain, drive = design(), through_motor(design(), MOTOR, "omega1", 1e6, gear)
    measured = {"theta1": np.pi / 2 + 0.01, "theta2": -0.02}
    x = jnp.array([np.pi / 2, 0.0, 0.4, -0.2])
    reference = {"theta1": np.pi / 2 + 0.05, "tau1": 0.03}
    (after, torque), command = plain.controller.update((x, jnp.array([0.1])), measured, reference, plain.parameters)
    (driven, given), volts = drive.controller.update((x, jnp.array([0.1])), measured, reference, drive.parameters)
    corrected = plain.parameters.estimator.corrected(
        x, jnp.array([measured["theta1"], measured["theta2"]]), jnp.array([0.1])
    )
    current = (volts["V"] - gear * MOTOR["Kb"] * corrected[2]) / MOTOR["Rm"]
    assert float(gear * MOTOR["Kt"] * current) == pytest.approx(float(command["tau1"]), rel=1e-12)
    np.testing.assert_allclose(driven, after, atol=1e-12)
    np.testing.assert_allclose(given, torque, rtol=1e-12)


def test_the_filter_is_told_what_the_clipped_voltage_gives():
    drive = through_motor(design(), MOTOR, "omega1", 0.5)
    measured = {"theta1": np.pi / 2 + 0.5, "theta2": -0.5}
    x = jnp.array([np.pi / 2, 0.0, 0.0, 0.0])
    (_, given), volts = drive.controller.update((x, jnp.zeros(1)), measured, {}, drive.parameters)
    speed = drive.parameters.feedback.estimator.corrected(x, jnp.array([np.pi / 2 + 0.5, -0.5]), jnp.zeros(1))[2]
    assert abs(float(volts["V"])) == 0.5
    assert float(given[0]) == pytest.approx(
        MOTOR["Kt"] * (float(volts["V"]) - MOTOR["Kb"] * float(speed)) / MOTOR["Rm"]
    )


def test_what_does_not_fit_is_refused():
    with pytest.raises(SimulationError, match="the motor's Kb is None"):
        through_motor(design(), {"Rm": 1.0, "Kt": 1.0}, "omega1", 12.0)
    with pytest.raises(SimulationError, match="'w' is no state"):
        through_motor(design(), MOTOR, "w", 12.0)
    plant = linearised(pendubot("base", velocity_output=True, joints=(1, 2)), BASE, UPRIGHT)
    both = lqr(plant, 1e-3, 1.0, 1.0, estimator=measured_states(plant, 1e-3))
    with pytest.raises(SimulationError, match="an lqr of one torque"):
        through_motor(both, MOTOR, "omega1", 12.0)
