# ruff: noqa: RUF001 (true minus, times and dash signs are meant)

import math

import numpy as np
import pytest

from plantfit.report.numbers import interval, plus_minus, seconds, significant, unit_label, with_unit


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.23456, 0.0123, "1.235 ± 0.012"),
        (1.23456, 0.0996, "1.23 ± 0.10"),  # rounding the error moves its first digit
        (2.31, 0.04, "2.310 ± 0.040"),
        (123456.0, 789.0, "123460 ± 790"),
        (-0.3, 1.2, "-0.3 ± 1.2"),
        (0.0, 0.05, "0.000 ± 0.050"),
        (-0.0001, 0.05, "0.000 ± 0.050"),
        (3.2e-5, 3.7e-6, "(3.20 ± 0.37)e-05"),
        (1e-9, 2e-6, "(0.0 ± 2.0)e-06"),
        (9.996e7, 1.2e5, "(9.996 ± 0.012)e+07"),
        (2.5, 0.0, "2.5"),
        (2.5, None, "2.5"),
        (2.5, math.inf, "2.5"),
        (None, 1.0, "–"),
        (math.nan, 1.0, "–"),
    ],
)
def test_error_has_two_digits_and_value_ends_at_its_place(value, error, text):
    assert plus_minus(value, error, ascii_only=True) == text


@pytest.mark.parametrize("scale", [1e-12, 1e-7, 1e-3, 1.0, 1e4, 1e9])
def test_written_value_and_error_are_within_half_a_unit_of_the_last_place(scale):
    rng = np.random.default_rng(0)
    for value, error in zip(scale * rng.normal(size=50), scale * 10 ** rng.uniform(-5, 1, 50), strict=True):
        text = plus_minus(value, error, ascii_only=True)
        body, _, power = text.partition(")")
        numbers = [float(part) * float(f"1{power}" if power else 1) for part in body.lstrip("(").split(" ± ")]
        assert abs(numbers[0] - value) <= 0.051 * error * (1 + 1e-9)
        assert abs(numbers[1] - error) <= 0.051 * error * (1 + 1e-9)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 4, "0"),
        (1234.5678, 6, "1234.57"),
        (0.00012345, 3, "1.23e-04"),
        (999999.6, 4, "1e+06"),
        (12345.0, 3, "12345"),
        (1e-6, 4, "1e-06"),
        (-2.5e12, 4, "-2.5e+12"),
        (None, 4, "–"),
        (math.inf, 4, "–"),
    ],
)
def test_significant_digits(value, digits, text):
    assert significant(value, digits, ascii_only=True) == text


def test_page_form_uses_a_power_of_ten_and_a_true_minus():
    assert significant(-1.5e-7) == "−1.5×10⁻⁷"
    assert plus_minus(3.2e-5, 3.7e-6) == "(3.20 ± 0.37)×10⁻⁵"


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (2.2316, 2.3884, "2.232 to 2.388"),
        (2.47e-5, 3.93e-5, "(2.47 to 3.93)e-05"),
        (-1.0, 1.0, "-1.0 to 1.0"),
        (0.0, 1e4, "0 to 10000"),
        (17.95, 1e4, "18 to 10000"),
        (2.5e-12, 4.0e-9, "(0.0025 to 4.0)e-09"),
        (5.0, 5.0, "5 to 5"),
        (2.4796392187804397e-3, 2.4796392187804535e-3, "(2.4796392 to 2.4796392)e-03"),
        (None, 1.0, "–"),
    ],
)
def test_interval(low, high, text):
    assert interval(low, high, ascii_only=True) == text


def test_units_read_well():
    assert unit_label("kg*m**2") == "kg·m²"
    assert unit_label("m*s**-2") == "m·s⁻²"
    assert unit_label("N * m * s / rad") == "N·m·s/rad"
    assert unit_label("1/delta_degree_Celsius") == "1/K"
    assert unit_label("(delta_degC)/s") == "K/s"
    assert unit_label("1/(m*s)") == "1/(m·s)"
    assert unit_label("dimensionless") == unit_label(None) == ""
    assert with_unit("R", "ohm") == "R [Ω]"
    assert with_unit("gain", None) == "gain"


@pytest.mark.parametrize(
    ("value", "text"), [(0.0213, "21 ms"), (3.214, "3.21 s"), (150.0, "2 min 30 s"), (7200.0, "2 h"), (None, "–")]
)
def test_durations(value, text):
    assert seconds(value) == text
