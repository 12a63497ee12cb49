"""How far a loop catches, against the closed form of an unstable plant with a limited input."""

from typing import Any

import numpy as np
import pytest
from plants import PERIOD, STICK, stick, upright

from plantfit.control import kalman_observer, largest_initial_angle, linearised, lqr
from plantfit.errors import SimulationError
from plantfit.models.text.equations import equations
from plantfit.simulate.loop.sensors import Actuator, Sensor

RUNAWAY = equations("x' = 2*x + k*u", inputs=["u"], states=["x"], outputs=["x"], parameters={"k": None}, name="runaway")


def loop_and_gain(low, high):
    plant = linearised(RUNAWAY, {"k": 1.0})
    design = lqr(plant, 0.01, {"x": 1.0}, {"u": 1e-4}, limits=(low, high))
    return design.close(RUNAWAY), design.parameters


def test_the_bracket_holds_the_closed_form():
    """From x, k u = -k high at most pulls back: caught where 2 x < k |limit|."""
    loop, gain = loop_and_gain(-1.0, 0.6)
    common: dict[str, Any] = {"largest": 3.0, "resolution": 1e-3, "seconds": 6.0, "tolerance": 0.01}
    for k in (1.0, 0.9):
        found = largest_initial_angle(loop, gain, {"k": k}, {"x": 0.0}, {"x": 1.0}, **common)
        assert 0.0 < found.resolution <= 1e-3
        assert found.high < 0.5 * k <= found.high + found.resolution
        assert found.low < 0.3 * k <= found.low + found.resolution
        assert (found.low_beyond, found.high_beyond) == (False, False)


def test_directions_scale_and_ends_may_not_be_reached():
    loop, gain = loop_and_gain(-1.0, 0.6)
    far: dict[str, Any] = {"largest": 0.2, "resolution": 1e-3, "seconds": 6.0, "tolerance": 0.01}
    found = largest_initial_angle(loop, gain, {"k": 1.0}, {"x": 0.0}, {"x": -2.0}, **far)
    assert (found.low, found.low_beyond, found.high_beyond) == (0.2, True, False)
    assert found.high == pytest.approx(0.15, abs=1e-3)


def test_a_loop_with_sensor_and_filter():
    plant = upright()
    design = lqr(
        plant,
        PERIOD,
        {"q": 1.0},
        {"u": 1.0},
        estimator=kalman_observer(plant, PERIOD, {"w": 1.0}, 1e-3),
        limits=(-0.1, 0.1),
    )
    loop = design.close(stick(), sensor=Sensor(quantum=1e-3), actuator=Actuator(-0.1, 0.1), stepper="rk4", substeps=1)
    found = largest_initial_angle(loop, design.parameters, STICK, {"q": 0.0}, {"q": 1.0}, largest=1.0, resolution=0.01)
    # the largest angle from which the torque still lifts the stick: a sin q = b u
    still = np.arcsin(50.0 * 0.1 / 20.0)
    assert 0.8 * still < found.high < still
    assert found.low == pytest.approx(found.high, abs=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"at": {"y": 0.0}}, "names 'y'"),
        ({"along": {"x": 0.0}}, "direction is 0"),
        ({"resolution": 0.0}, "resolution = 0"),
        ({"settled": 5.0}, "settled = 5"),
        ({"plant": {"k": -1.0}}, "does not hold"),
    ],
)
def test_bad_input_is_named(change, words):
    loop, gain = loop_and_gain(-1.0, 1.0)
    arguments = {"plant": {"k": 1.0}, "at": {"x": 1e-3}, "along": {"x": 1.0}} | change
    with pytest.raises(SimulationError, match=words):
        largest_initial_angle(loop, gain, tolerance=0.01, **arguments)
