"""Fits that the tests of all targets share."""

import pytest
from exported_plants import ARM, HEATER, ROOTS, answered


@pytest.fixture(scope="session")
def heater():
    return answered(HEATER, {"K": 0.8, "T0": 21.0, "tau": 12.0, "L": 1.37}, {"x": {"initial": 20.0}}, ["T"], 80.0)


@pytest.fixture(scope="session")
def arm():
    truth = {"gain": 3.0, "drag": 0.05, "rub": 0.4, "inertia": 0.7, "L": 0.23}
    return answered(ARM, truth, {"w": {"initial": 0.5}, "a": {"initial": 0.1}}, ["y", "z"], 20.0)


@pytest.fixture(scope="session")
def roots():
    return answered(ROOTS, {"k": 2.0, "tau": 3.0}, {"x": {"initial": 2.0}}, ["s", "l", "d"], 20.0)


@pytest.fixture(params=["heater", "arm", "roots"])
def answer(request):
    return request.getfixturevalue(request.param)
