"""Linearised models against matrices by hand, and equilibria against their formulas."""

import numpy as np
import pytest
from scipy.linalg import expm

from plantfit.control import discretised, equilibrium, linearised
from plantfit.errors import SimulationError
from plantfit.models.library.pendubot import pendubot
from plantfit.models.text.equations import equations

G, L1 = 9.81, 0.15
ARM = {"b1": 0.005, "b2": 0.003, "b4": 0.04, "b5": 0.015, "kt": 0.07, "ke": 0.08, "Ra": 3.0}
UP = {"theta1": np.pi / 2, "theta2": 0.0}


def test_the_upright_pendubot_equals_the_matrices_by_hand():
    b3 = L1 * ARM["b5"]
    mass = np.array([[ARM["b1"] + ARM["b2"] + 2 * b3, ARM["b2"] + b3], [ARM["b2"] + b3, ARM["b2"]]])
    # minus the slope of gravity's torque
    falling = G * np.array([[ARM["b4"] + ARM["b5"], ARM["b5"]], [ARM["b5"], ARM["b5"]]])
    damping = np.array([[ARM["kt"] * ARM["ke"] / ARM["Ra"], 0.0], [0.0, 0.0]])
    inverse = np.linalg.inv(mass)
    plant = linearised(pendubot("base", drive="voltage"), ARM, UP)
    np.testing.assert_allclose(
        plant.A, np.block([[np.zeros((2, 2)), np.eye(2)], [inverse @ falling, -inverse @ damping]]), atol=1e-10
    )
    np.testing.assert_allclose(plant.B[:, 0], [0.0, 0.0, *(inverse @ [ARM["kt"] / ARM["Ra"], 0.0])], rtol=1e-12)
    np.testing.assert_allclose(plant.C, np.eye(2, 4), atol=0)
    assert (plant.states, plant.inputs, plant.outputs) == (
        ("theta1", "theta2", "omega1", "omega2"),
        ("V",),
        ("theta1", "theta2"),
    )
    assert plant.units["omega2"] == "rad/s"
    np.testing.assert_allclose(plant.y0, [np.pi / 2, 0.0])


def test_a_held_pose_of_the_pendubot():
    model = pendubot("base", drive="voltage")
    x0, u0 = equilibrium(model, ARM, {"theta1": 1.2, "theta2": 0.1}, fixed=["theta1"])
    assert x0 == pytest.approx({"theta1": 1.2, "theta2": np.pi / 2 - 1.2, "omega1": 0.0, "omega2": 0.0}, abs=1e-9)
    assert u0["V"] == pytest.approx(ARM["b4"] * G * np.cos(1.2) * ARM["Ra"] / ARM["kt"], rel=1e-9)
    assert linearised(model, ARM, x0, u0).u0[0] == u0["V"]


def test_sampling_is_the_matrix_exponential():
    plant = linearised(pendubot("base", drive="voltage"), ARM, UP)
    big = np.zeros((5, 5))
    big[:4, :4], big[:4, 4:] = plant.A, plant.B
    sampled = discretised(plant, 0.02)
    np.testing.assert_allclose(sampled.A, expm(0.02 * big)[:4, :4], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(sampled.B, expm(0.02 * big)[:4, 4:], rtol=1e-10, atol=1e-12)
    assert sampled.period == 0.02


def tank():
    return equations(
        "h' = q - k*sqrt(h)", inputs=["q"], states=["h"], outputs=["h"], parameters={"k": None}, name="tank"
    )


def test_an_output_that_reads_the_input():
    lead = equations(
        "z' = u - a*z\ny = 2*u - a*z", inputs=["u"], states=["z"], outputs=["y"], parameters={"a": None}, name="lead"
    )
    plant = linearised(lead, {"a": 3.0}, {"z": 1.0}, {"u": 3.0})
    np.testing.assert_allclose(
        [plant.A[0, 0], plant.B[0, 0], plant.C[0, 0], plant.D[0, 0], plant.y0[0]], [-3.0, 1.0, -3.0, 2.0, 3.0]
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: linearised(tank(), {"k": 1.0}, {"h": 4.0}, {"q": 1.0}), r"rate of 'h' is -1 .*equilibrium\(\)"),
        (lambda: linearised(tank(), {}, {"h": 4.0}), "no value for parameter 'k'"),
        (lambda: linearised(tank(), {"k": 1.0}, {"level": 4.0}), "names 'level'"),
        (lambda: linearised(tank(), {"k": 1.0}, {"h": 1.0}, {"u": 4.0}), "u0 names 'u'"),
        (lambda: equilibrium(tank(), {"k": 1.0}, {"h": 4.0}, {"q": 1.0}, fixed=["h", "q"]), "stays at -1"),
        (lambda: equilibrium(tank(), {"k": 1.0}, {"h": 4.0}, fixed=["z"]), "no state or input 'z'"),
        (lambda: discretised(linearised(tank(), {"k": 1.0}, {"h": 4.0}, {"q": 2.0}), 0.0), "period = 0.0"),
        (
            lambda: discretised(discretised(linearised(tank(), {"k": 1.0}, {"h": 4.0}, {"q": 2.0}), 1.0), 1.0),
            "discrete already",
        ),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()


def test_dry_friction_is_refused():
    block = equations(
        "v' = F - friction(v, 1.0, 1.0)", inputs=["F"], states=["v"], outputs=["v"], parameters={}, name="block"
    )
    with pytest.raises(SimulationError, match="dry friction"):
        linearised(block, {})
