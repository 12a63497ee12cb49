"""Names, settings and the sentences that wrong ones get."""

import json
from typing import Any

import numpy as np
import pytest

from plantfit.errors import SearchError
from plantfit.optimize import Objective, make, methods, minimise
from plantfit.testing.objectives import bowl


def test_methods_are_plain_records():
    records = methods()
    assert {"random", "pso", "cmaes", "lbfgsb", "least_squares", "auto"} <= {r["name"] for r in records}
    assert json.loads(json.dumps(records)) == records
    for record in records:
        assert record["sentence"].endswith(".")
        assert record["paper"]
        assert all(s["sentence"] for s in record["settings"]), record["name"]
        make(record["name"], **{s["name"]: s["default"] for s in record["settings"] if s["default"] is not None})


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("psoo", {}, "Did you mean 'pso'"),
        ("pso", {"popultion": 3}, "Did you mean 'population'"),
        ("pso", {"population": 2}, "outside its range"),
        ("pso", {"population": 20.5}, "whole number"),
        ("pso", {"inertia": "big"}, "give a number"),
        ("pso", {"inertia": float("nan")}, "give a number"),
        ("pso", {"population": True}, "give a number"),
        ("pso", {"topology": "rng"}, "Did you mean 'ring'"),
        ("least_squares", {"loss": "square"}, "use one of"),
    ],
)
def test_wrong_names_and_settings(name, settings, words):
    with pytest.raises(SearchError, match=words) as raised:
        make(name, **settings)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"runs": 0}, "runs is 0"),
        ({"budget": 2.5}, "budget is 2.5"),
        ({"seed": -1}, "seed is -1"),
        ({"budget": 5, "method": "pso"}, "one generation"),
        ({"target": float("nan")}, "target"),
        ({"stagnation": 0}, "stagnation is 0"),
    ],
)
def test_wrong_numbers(changes, words):
    given: dict[str, Any] = {"method": "random", **changes}
    with pytest.raises(SearchError, match=words):
        minimise(bowl(2), **given)


@pytest.mark.parametrize(("method", "words"), [("least_squares", "needs residuals"), ("lbfgsb", "needs a gradient")])
def test_needs(method, words):
    with pytest.raises(SearchError, match=words):
        minimise(Objective(2, bowl(2).costs), method)


def test_no_free_parameter():
    with pytest.raises(SearchError, match="no free parameter"):
        minimise(Objective(0, bowl(2).costs), "random")


def test_cost_of_wrong_shape():
    with pytest.raises(SearchError, match="one cost for each"):
        minimise(Objective(2, lambda x: x), "random", budget=100)


def test_warm_start_of_wrong_shape():
    with pytest.raises(SearchError, match="Warm starts"):
        minimise(Objective(2, bowl(2).costs, start=np.zeros((1, 3))), "random", budget=100)
