"""Units: the spellings of benches, conversions against textbook factors, and what is refused."""

import math
import subprocess
import sys

import numpy as np
import pytest

from plantfit import units
from plantfit.errors import UnitError


@pytest.mark.parametrize(
    ("spelling", "plain"),
    [
        ("°C", "degC"), ("deg C", "degC"), ("°/s", "deg/s"), ("Nm", "N*m"), ("N m", "N*m"), ("mNm", "mN*m"),
        ("kg m^2", "kg*m**2"),
        ("kg·m²", "kg*m**2"), ("kgm²", "kg*m**2"), ("kg.m^2", "kg*m**2"), ("Ω", "ohm"), ("kOhm", "kohm"), ("µV", "uV"),
        ("V s/rad", "V*s/rad"), ("Vs/rad", "V*s/rad"), ("s⁻¹", "1/s"), ("s-1", "1/s"), ("/s", "1/s"),
        ("m3/h", "m**3/h"),
        ("-", "1"), ("", "1"), ("sec", "s"), ("counts", "count"), ("RPM", "rpm"), ("Rpm", "rpm"), ("U/min", "rpm"),
        ("U/min/V", "rpm/V"), ("(U/min)/s", "rpm/s"),
        ("1/(U/min)", "1/rpm"), ("(tr/min)/%", "rpm/%"),
        ("tr/min", "rpm"),
        ("rev/min", "rpm"), ("r/min", "rpm"), ("rev/s", "turn/s"), ("V/RPM", "V/rpm"),
    ],
)  # fmt: skip
def test_spellings_mean_the_same(spelling, plain):
    assert units.factor_offset(spelling, plain) == pytest.approx((1.0, 0.0), rel=1e-14)


@pytest.mark.parametrize(
    ("value", "source", "target", "expected"),
    [
        (60.0, "rpm", "rad/s", 2 * math.pi), (180.0, "deg/s", "rad/s", math.pi), (25.0, "degC", "K", 298.15),
        (212.0, "degF", "degC", 100.0),
        (50.0, "%", "1", 0.5), (2.0, "degC/s", "K/s", 2.0), (3.0, "degC/%", "K", 300.0), (6.0, "l/min", "m^3/s", 1e-4),
        (1.0, "bar", "kPa", 100.0), (1.0, "V/(deg/s)", "V*s/rad", 180 / math.pi), (12.0, "PWM", "counts", 12.0),
    ],
)  # fmt: skip
def test_conversion(value, source, target, expected):
    assert units.convert(value, source, target) == pytest.approx(expected, rel=1e-12)
    assert units.convert(units.convert(np.array([value]), source, target), target, source) == pytest.approx(
        [value], rel=1e-12
    )


@pytest.mark.parametrize(
    "text", ["rmp", "10 V", "nan", "left", "9**9**9**9", "m**99999", "dB", "__import__('os')", "(", "a" * 200]
)
def test_unknown_units_are_refused(text):
    with pytest.raises(UnitError):
        units.parse(text)
    assert not units.known(text)


def test_close_match_is_named():
    with pytest.raises(UnitError, match="'rpm'"):
        units.parse("rmp")


@pytest.mark.parametrize("unit", ["mm**1e9", "um**60", "km**1e9"])
def test_a_unit_whose_size_is_no_number_is_refused(unit):
    with pytest.raises(UnitError, match="is too large or too small to be a number of SI units"):
        units.parse(unit)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("V", "A"),
        ("Hz", "rad/s"),
        ("rpm", "Hz"),
        ("degC", "degC/s"),
        ("1/min", "rad/s"),
        ("min-1", "rpm"),
        ("counts", "rad"),
        ("tick/s", "rpm"),
    ],
)
def test_incompatible(a, b):
    assert not units.compatible(a, b)
    with pytest.raises(UnitError):
        units.factor_offset(a, b)


def test_import_does_not_build_the_registry():
    code = "import sys, plantfit.units; sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("rad/s", "1/s"),
        ("rpm", "turn/s"),
        ("l/min", "m^3/s"),
        ("counts", "1"),
        ("counts/turn", "1/rad"),
        ("%/min", "1/s"),
    ],
)
def test_what_says_its_turns_or_has_none_is_converted(a, b):
    assert units.compatible(a, b)


def test_a_refusal_says_how_turns_are_written():
    with pytest.raises(UnitError, match="write 'rpm' instead of '1/min'"):
        units.factor_offset("1/min", "rad/s")
    with pytest.raises(UnitError, match="counts_to_angle"):
        units.factor_offset("counts", "rad")


@pytest.mark.parametrize("below", ["N*m", "N m", "N·m", "N⋅m", "N.m", "kgm^2", "kg m^2", "V/A", "K", "m^2", "1/s"])
def test_a_quotient_has_all_of_the_unit_below_its_line(below):
    found = units.parse(units.quotient("rad/s", below))
    assert found.dimensionality == (units.parse("rad/s") / units.parse(below)).dimensionality
    # pyrefly: ignore[bad-argument-type]  (products of units are units)
    assert units.factor_offset(found * units.parse(below), "rad/s")[0] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "dB",
        "dBm",
        "dBV",
        "dBFS",
        "dB(A)",
        "dB/s",
        "1/dB",
        "bel",
        "decibel",
        "cNp",
        "Np",
        "phon",
        "dex",
        "log10 V",
        "ln(V)",
    ],
)
def test_levels_are_told_apart_from_units(text):
    assert units.logarithmic(text)


@pytest.mark.parametrize("text", ["B", "kB", "mbar", "dbar", "lm", "Bq", "bbl", "N*p", "N", "V^2"])
def test_other_units_are_no_levels(text):
    assert not units.logarithmic(text)


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [("s", "sec", True), ("s", "min", False), ("Hz", "1/s", True), ("degC", "K", False), ("s", "m", False)],
)
def test_a_number_means_the_same_in_equal_units(a, b, same):
    assert units.equal(a, b) is bool(same)


def test_a_quantity_without_a_unit_to_be_in_is_not_taken_as_its_number():
    assert units.in_unit("limit T", "290", None) == 290.0
    with pytest.raises(UnitError, match="limit T = '290 K': the model has no unit for it"):
        units.in_unit("limit T", "290 K", None)
