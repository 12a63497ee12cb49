"""What a model declares of a parameter and what a user says of it, merged: no field is lost on the way."""

import dataclasses
from typing import Any

import pytest

from plantfit.models.model import Declared
from plantfit.problem.parameters import space_of
from plantfit.space import Parameter
from plantfit.spec.tables import ParameterTable

# one value for every field that is not its default; a new field needs one here
SAID: dict[str, Any] = {
    "bounds": (1.0, 4.0), "unit": "s", "scale": "log", "value": 2.0, "tied": "other", "per_recording": True,
    "start": 3.0,
    "sentence": "how long it takes", "shape": (2,), "smooth": 0.3, "limits": (0.5, 8.0), "typical": 2.5,
}  # fmt: skip
FIELDS = [f.name for f in dataclasses.fields(Parameter)]


def merged(declared, change):
    others = (Declared("other", "s", (1.0, 4.0)), Declared("last", "s", (1.0, 4.0)))
    return space_of((declared, *others), None if change is None else {"a": change}, ("run",)).parameters["a"]


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Declared) if f.name != "name"])
def test_what_a_model_declares_stays_where_the_user_says_nothing_of_it(field):
    given: dict[str, Any] = {"bounds": (1.0, 4.0)} | {field: SAID[field]}
    for change in (None, Parameter(), Parameter(start=1.5)):
        assert getattr(merged(Declared("a", **given), change), field) == SAID[field]


@pytest.mark.parametrize("field", FIELDS)
def test_what_a_user_says_goes_into_the_space(field):
    declared = Declared("a", bounds=(0.7, 6.0), shape=(2,) if field == "shape" else ())
    assert getattr(merged(declared, Parameter(**{field: SAID[field]})), field) == SAID[field]


def test_a_field_that_comes_later_is_not_dropped(monkeypatch):
    """As `typical` once came, with nothing but a line in each of the three classes."""
    later = dataclasses.make_dataclass("Later", [("weight", float | None, None)], bases=(Parameter,), frozen=True)
    declared = dataclasses.make_dataclass(
        "DeclaredLater", [("weight", float | None, None)], bases=(Declared,), frozen=True
    )
    monkeypatch.setattr("plantfit.problem.parameters.Parameter", later)
    monkeypatch.setattr("plantfit.problem.parameters.Declared", declared)
    known = declared("a", bounds=(0.7, 9.0), weight=2.0)
    for change, expected in ((None, 2.0), (later(), 2.0), (later(start=1.0), 2.0), (later(weight=5.0), 5.0)):
        found = space_of((known,), None if change is None else {"a": change}, ("run",)).parameters["a"]
        assert found.weight == expected  # pyrefly: ignore[missing-attribute]


def test_the_study_file_has_every_field_but_the_shape():
    assert set(ParameterTable.model_fields) == set(FIELDS) - {"shape"}


def test_another_unit_of_the_user_becomes_that_of_the_model():
    change = Parameter((60.0, 600.0), unit="min", start=120.0, value=None, limits=(6.0, 6000.0), typical=30.0)
    found = merged(Declared("a", "h", (0.1, 2.0)), change)
    assert found.unit == "h"
    assert found.bounds == pytest.approx((1.0, 10.0))
    assert found.limits == pytest.approx((0.1, 100.0))
    assert (found.start, found.typical) == pytest.approx((2.0, 0.5))
