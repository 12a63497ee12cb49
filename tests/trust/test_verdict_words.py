"""Numbers with their standard errors in sentences."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust.verdict.words import estimate, interval


@pytest.mark.parametrize(("error", "said"), [
    (4.5e-16, "R = 2 ohm (exact to rounding)"), (0.04, "R = 2.000 ± 0.040 ohm"),
    (1e-8, "R = 2.000000000 ± 0.000000010 ohm"),
])  # fmt: skip
def test_a_standard_error_of_rounding_is_told_as_such(error, said):
    assert estimate({"name": "R", "value": 2.0, "standard_error": error, "unit": "ohm"}) == said


@pytest.mark.parametrize(
    ("unit", "said"), [("V", "k = 0.500 ± 0.020 V"), ("1", "k = 0.500 ± 0.020"), (None, "k = 0.500 ± 0.020")]
)
def test_a_number_without_unit_is_told_without(unit, said):
    assert estimate({"name": "k", "value": 0.5, "standard_error": 0.02, "unit": unit}) == said


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_exact_data_give_exact_parameters_and_noisy_ones_do_not(noise):
    u = np.linspace(-1, 1, 40)
    model = pf.equations(
        "y = a + b*u", inputs={"u": "1"}, outputs={"y": "1"}, parameters=["a", "b"], name="line", check=False
    )
    y = 1 + 2 * u + noise * np.random.default_rng(0).normal(size=40)
    record = pf.from_arrays({"u": u, "y": y}, period=1.0, units={"u": "1", "y": "1"})
    verdict = pf.fit(pf.Problem(model, record, {"a": (-10.0, 10.0), "b": (-10.0, 10.0)}), seed=1).verdict
    assert ("a = 1 (exact to rounding), b = 2 (exact to rounding)" in verdict) == (noise == 0)
    assert ("exact to rounding" in verdict) == (noise == 0)


@pytest.mark.parametrize(
    ("low", "high", "beside", "said"),
    [
        (0.1, 0.3, None, "0.1 to 0.3 V"),
        (0.00179998, 0.00180003, None, "0.00179998 to 0.00180003 V"),
        (-5.0, 5.0, None, "-5 to 5 V"),
        (0.0, np.inf, None, "0 to inf V"),
        (2.0, 2.0, None, "2 to 2 V"),
        (1.98, 2.03, 1e-4, "1.98 to 2.03 V"),
        (1.98761, 2.03449, 1e-4, "1.98761 to 2.03449 V"),
    ],
)
def test_the_ends_of_an_interval_can_be_told_apart(low, high, beside, said):
    assert interval(low, high, "V", beside=beside) == said
