"""What the verdict says of a parameter that the data press onto a bound."""

import pytest

from plantfit.trust.verdict.parameters import parameter_sentences


def said(bound, low, value):
    row = {
        "name": "L", "parameter": "L", "recording": None, "index": [], "unit": "s", "value": value,
        "standard_error": 0.1,
        "lower_bound": low, "upper_bound": 5.0, "status": "at bound", "at_bound": bound,
    }  # fmt: skip
    return next(v["sentence"] for v in parameter_sentences({"parameters": [row]}) if v["sentence"].startswith("L "))


def test_a_dead_time_on_zero_cannot_be_told_from_zero():
    text = said("lower", 0.0, 0.0)
    assert text.startswith("L ended on its lower bound, 0 s, and cannot be told from zero")
    assert "pull it further" not in text


@pytest.mark.parametrize(("bound", "low", "value"), [("upper", 0.0, 5.0), ("lower", 0.5, 0.5)])
def test_other_bounds_are_pressed(bound, low, value):
    assert f"L ended on its {bound} bound, {value:g} s: the data pull it further" in said(bound, low, value)
