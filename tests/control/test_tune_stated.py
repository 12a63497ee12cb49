"""Plants within stated tolerances and of given draws, what is refused, and the units of gains."""

import numpy as np
import pytest

from plantfit.control.pid import gain_units
from plantfit.control.tune.stated import given_draws, half_width, toleranced
from plantfit.errors import SpecError, UnitError

VALUES = {"K": -2.0, "tau": 10.0, "L": 0.0, "table": np.array([1.0, 2.0])}
UNITS = {"K": "K/V", "tau": "s", "L": "s"}


def test_plants_lie_evenly_within_their_tolerances():
    found = toleranced(VALUES, {"K": "10 %", "tau": "200 ms", "L": 0.3}, UNITS, 20_000, 1)
    assert {n: v[0] for n, v in found.items() if n != "table"} == {n: v for n, v in VALUES.items() if n != "table"}
    for name, half in (("K", 0.2), ("tau", 0.2), ("L", 0.3)):
        off = (found[name][1:] - VALUES[name]) / half
        assert np.abs(off).max() <= 1.0
        np.testing.assert_allclose(np.quantile(off, [0.25, 0.5, 0.75]), [-0.5, 0.0, 0.5], atol=0.02)
    np.testing.assert_array_equal(found["table"], np.tile([1.0, 2.0], (20_001, 1)))
    assert not np.array_equal(found["tau"], toleranced(VALUES, {"tau": "200 ms"}, UNITS, 20_000, 2)["tau"])


@pytest.mark.parametrize(("asked", "said"), [
    ({"T": "10 %"}, "names 'T'; the model has the parameters K, tau"), ({"tau": "0 %"}, "leaves no room"),
    ({"tau": "120 %"}, "takes tau = 10 to the other side of 0"), ({"tau": "ten %"}, "is no number before the %"),
    ({"table": 0.1}, "a table has no one tolerance"),
])  # fmt: skip
def test_tolerances_that_cannot_be_are_said(asked, said):
    with pytest.raises(SpecError, match=said):
        toleranced(VALUES, asked, UNITS, 10, 1)


def test_a_tolerance_in_another_unit_is_converted_or_refused():
    assert half_width("tau", "+-0.5 min", 100.0, "s") == 30.0
    with pytest.raises(UnitError, match=r"tolerances\.tau"):
        half_width("tau", "2 K", 100.0, "s")


def test_given_draws_stand_behind_the_best_fit():
    found = given_draws(VALUES, {"tau": np.arange(1.0, 121.0)}, 100)
    np.testing.assert_array_equal(found["tau"], np.r_[10.0, np.arange(1.0, 121.0)])
    assert np.all(found["K"] == -2.0)
    with pytest.raises(SpecError, match="has 5 plants; give 100 or more"):
        given_draws(VALUES, {"tau": np.ones(5)}, 100)
    with pytest.raises(SpecError, match="arrays of one length"):
        given_draws(VALUES, {"tau": np.ones(200), "K": np.ones(100)}, 100)
    with pytest.raises(SpecError, match="names 'T'"):
        given_draws(VALUES, {"T": np.ones(200)}, 100)


@pytest.mark.parametrize(("output", "given", "units"), [
    ("rad/s", "V", ("V/(rad/s)", "V/rad", "V/(rad/s^2)")), ("degC", "%", ("%/degC", "%/degC/s", "%*s/degC")),
    ("K", "1", ("1/K", "1/K/s", "s/K")), ("1", "1", ("1", "1/s", "s")), (None, "V", ("1", "1/s", "s")),
    ("m/s", "m/s", ("1", "1/s", "s")),
    ("N*m", "A", ("A/(N*m)", "A/(N*m)/s", "A*s/(N*m)")),
])  # fmt: skip
def test_gains_have_the_units_of_input_over_output(output, given, units):
    assert tuple(gain_units(output, given).values()) == units
