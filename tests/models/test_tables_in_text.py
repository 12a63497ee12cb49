"""Tables in equations and in the study file: values, units, and the place of every mistake."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_calls import derivative, initial_state

from plantfit import spec
from plantfit.errors import EquationError, ModelError, SpecError
from plantfit.models import Declared, Model, Table, describe, equations

import jax

CHAMBER = """
    x1' = x2
    x2' = (k(x1)*delay(u, Td) - x1 - A1(x1)*x2)/A2(x1)
    y = x1
"""
NODES = np.linspace(0, 20, 10)


def over_pressure(unit):
    return {"over": ["y"], "nodes": {"from": 0, "to": 20, "count": 10}, "unit": unit}


def chamber(**changes):
    given: dict[str, Any] = {
        "inputs": {"u": "%"},
        "states": {"x1": "bar", "x2": "bar/s"},
        "outputs": {"y": "bar"},
        "parameters": {"Td": "s", "k": {"bounds": (0.1, 1.5)}, "A1": {"bounds": ([0.1] * 10, 160), "scale": "log"}},
        "tables": {"k": over_pressure("bar/%"), "A1": over_pressure("s"), "A2": over_pressure("s^2")},
    }
    return equations(changes.pop("text", CHAMBER), **{**given, **changes})


def test_tables_become_parameters_with_a_shape():
    model = chamber()
    assert {p.name: p.shape for p in model.parameters} == {"Td": (), "k": (10,), "A1": (10,), "A2": (10,)}
    assert (model.declared("k").unit, model.declared("k").bounds) == ("bar/%", (0.1, 1.5))
    assert (model.declared("A1").bounds, model.declared("A1").scale) == (((0.1,) * 10, 160.0), "log")
    assert model.declared("A2").bounds is None
    assert "10 values, 0.1 to 1.5" in describe(model)


def test_right_hand_side_equals_numpy():
    rng = np.random.default_rng(0)
    p = {"Td": 0.3, "k": rng.random(10), "A1": 1 + rng.random(10), "A2": 1 + rng.random(10)}
    for x1 in (-1.0, 3.3, 12.0, 25.0):
        found = derivative(chamber())({"x1": x1, "x2": 0.4}, {"u": 0.0, "delay(u, Td)": 50.0, "t": 0.0}, p)
        k, a1, a2 = (np.interp(x1, NODES, p[n]) for n in ("k", "A1", "A2"))
        assert float(found["x1"]) == 0.4
        assert float(found["x2"]) == pytest.approx((k * 50 - x1 - a1 * 0.4) / a2, rel=1e-12)


def test_results_keep_the_shape_of_the_signals_not_of_the_tables():
    model, p = chamber(), {"Td": 0.3, "k": np.ones(10), "A1": np.ones(10), "A2": np.ones(10)}
    x, u = {"x1": np.zeros(7), "x2": np.zeros(7)}, {"u": np.ones(7), "delay(u, Td)": np.ones(7), "t": np.zeros(7)}
    assert [v.shape for v in derivative(model)(x, u, p).values()] == [(7,), (7,)]
    assert model.output(x, u, p)["y"].shape == (7,)
    assert [np.shape(v) for v in initial_state(model)(p, {"u": 1.0}, {"y": 0.0}).values()] == [(), ()]


def test_table_of_an_expression_inside_a_piecewise_branch_and_at_the_start():
    model = equations(
        "x' = -k(2*x - 1) if x > 0 else k(x)^2; y = x",
        states={"x": {"initial": "2*k(y + 1)"}},
        outputs=["y"],
        tables={"k": {"over": "y", "nodes": [0, 1, 4]}},
    )
    k = np.array([1.0, 3.0, 6.0])
    assert float(derivative(model)({"x": 1.5}, {}, {"k": k})["x"]) == -np.interp(2.0, [0, 1, 4], k)
    assert float(initial_state(model)({"k": k}, {}, {"y": 1.0})["x"]) == 2 * np.interp(2.0, [0, 1, 4], k)
    slope = jax.grad(lambda k: derivative(model)({"x": -1.0}, {}, {"k": k})["x"])(k)
    np.testing.assert_allclose(slope, [2.0, 0.0, 0.0])


def test_table_over_two_signals():
    model = equations(
        "y = K(u, v + 1)",
        inputs=["u", "v"],
        outputs=["y"],
        tables={"K": {"over": ["u", "v"], "nodes": [[0, 1], {"from": 0, "to": 4, "count": 3}]}},
    )
    assert model.declared("K").shape == (2, 3)
    values = np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]])
    assert float(model.output({}, {"u": 0.5, "v": 2.0}, {"K": values})["y"]) == 6.5


def test_known_characteristic():
    table = Table("valve", ("u",), ((0.0, 50.0, 100.0),), "kg/s")
    known = [Declared("valve", value=[0, 1, 4])]
    model = equations(
        "y = valve(u)", inputs={"u": "%"}, outputs={"y": "kg/s"}, tables={"valve": table}, parameters=known
    )
    assert model.declared("valve").value == (0.0, 1.0, 4.0)
    assert "3 values, = 0 to 4" in describe(model)


PLACES = [
    # text of the second line, column, part of the message
    ("x2' = k(x1, u)*delay(u, Td) - A1(x1) - A2(x1)", 6, "The table 'k' takes 1 arguments, not 2; write k(y)"),
    ("x2' = kk(x1)*delay(u, Td) - A1(x1) - A2(x1)", 6, "'kk' is not known. Did you mean 'k'?"),
    ("x2' = A3(x1)*delay(u, Td) - A1(x1) - A2(x1)", 6, "a table must be declared"),
    ("x2' = k*delay(u, Td) - A1(x1) - A2(x1)", 6, "'k' is a table; write k(y)"),
    ("x2' = k(y=x1)*delay(u, Td) - A1(x1) - A2(x1)", 6, "write k(y)"),
    ("x2' = k(x1)*delay(u, A1) - A1(x1) - A2(x1) + Td", 21, "a parameter, a constant or a number"),
    (
        "x2' = k(x2)*delay(u, Td)/A2(x1) - A1(x1)",
        8,
        "The table 'k' over 'y': its argument must be in bar, but this is in bar/s",
    ),
    ("x2' = k(2*u)*delay(u, Td)/A2(x1) - A1(x1)", 8, "must be in bar, but this is in %"),
    ("x2' = k(x1)*delay(u, Td)/A2(x1) - A1(x1)", 32, "'-' joins bar/s² and s"),
]


@pytest.mark.parametrize(("line", "column", "words"), PLACES)
def test_mistakes_are_shown_where_they_are(line, column, words):
    with pytest.raises(EquationError) as caught:
        chamber(text=f"x1' = x2\n{line}\ny = x1")
    assert words in caught.value.reason
    assert (caught.value.line, caught.value.column) == (1, column)


def test_bare_table_at_the_start():
    with pytest.raises(EquationError, match=r"Initial value of 'x1': 'k' is a table; write k\(y\)"):
        chamber(states={"x1": {"unit": "bar", "initial": "k"}, "x2": "bar/s"})


CONTRADICTIONS = [
    ({"over": ["yy"], "nodes": [[0, 1]]}, "over 'yy', which is no signal. Did you mean 'y'?"),
    ({"over": ["y"], "nodes": [[0]]}, "give at least 2"),
    ({"over": ["y"], "nodes": [[0, 2, 1]]}, "do not increase at number 2 (2, then 1)"),
    ({"over": ["y"], "nodes": [[0, "a"]]}, "have 'a'; write finite numbers"),
    ({"over": ["y"], "nodes": [[0, 1], [0, 1]]}, "one list of nodes for each"),
    ({"over": ["y"], "nodes": {"from": 0, "to": 1}}, "count = 10"),
    ({"over": ["y"], "nodes": {"from": 0, "to": 1, "count": 1}}, "count 1; write a whole number"),
    ({"over": ["y"], "nodes": {"from": 1, "to": 0, "count": 3}}, "do not increase"),
    ({"over": ["y"], "nodes": "many"}, "'many'; write a list of numbers"),
    ({"over": ["y"]}, "has no 'nodes'"),
    ({"over": [3], "nodes": [[0, 1]]}, "write names of signals"),
    ({"over": ["y"], "node": [[0, 1]]}, "Did you mean 'nodes'?"),
    ({"over": ["y"], "nodes": [[0, 1]], "unit": 3}, "the unit of table 'k' is 3"),
    ({"over": ["y"], "nodes": [[0, 1, 2]], "unit": "s"}, "table 'k' is in 's' but its parameter in 'bar'"),
    ({"over": ["y"], "nodes": [[0, 1]]}, "has 2 nodes but a bound (0.0, 0.0, 0.0)"),
    (Table("K", ("y",), ((0.0, 1.0),)), "has a declaration for 'K'"),
    (5, "table 'k' is 5"),
]


@pytest.mark.parametrize(("table", "words"), CONTRADICTIONS)
def test_contradicting_declarations(table, words):
    parameters = {"k": {"unit": "bar", "bounds": ((0, 0, 0), 1)}}
    with pytest.raises(ModelError) as caught:
        equations("y = k(u)", inputs=["u"], outputs=["y"], tables={"k": table}, parameters=parameters)
    assert not isinstance(caught.value, EquationError)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [("sin", "use themselves"), ("u", "declared in inputs and in tables"), ("a b", "letters, digits")],
)
def test_names_of_tables(name, words):
    with pytest.raises(ModelError, match=words):
        equations("y = u", inputs=["u"], outputs=["y"], tables={name: {"over": ["u"], "nodes": [[0, 1]]}})


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ({"value": [1, 2]}, "has a value of an array but is no table"),
        ({"bounds": ([0, 1], 2)}, "has a bound of an array"),
        (Declared("k", shape=(3,)), r"the shape \(3,\) of an array"),
        ({"bounds": ([[0, 1], [2]], 2)}, "has a bound of an array"),
    ],
)
def test_arrays_that_are_no_tables(parameter, words):
    with pytest.raises(ModelError, match=words):
        equations("y = k*u", inputs=["u"], outputs=["y"], parameters={"k": parameter})


def test_unused_table_is_named():
    with pytest.raises(ModelError, match="parameter 'k' is never used"):
        equations("y = u", inputs=["u"], outputs=["y"], tables={"k": {"over": ["u"], "nodes": [[0, 1]]}})


STUDY = """
name = "chamber"
[recording.steam]
file = "steam.csv"
[model]
equations = "y = k(u)*u + valve(u)"
inputs = { u = "%" }
outputs = { y = "bar" }
[model.tables.k]
over = ["u"]
nodes = { from = 0, to = 100, count = 3 }
unit = "bar/%"
[model.tables.valve]
over = ["u"]
nodes = [[0, 50, 75, 100]]
unit = "bar"
[parameters.k]
bounds = [0.1, 1.5]
start = [0.2, 0.3, 0.4]
[parameters.valve]
value = [0, 1, 2, 4]
"""
FILE = Path("chamber.toml")


def test_tables_in_a_study_file():
    table = spec.validated(STUDY, FILE)
    model = spec.model_of(table, FILE)
    assert isinstance(model, Model)
    values = {"k": np.array([1.0, 2.0, 3.0]), "valve": np.array(model.declared("valve").value)}
    assert float(model.output({}, {"u": 60.0}, values)["y"]) == pytest.approx(2.2 * 60 + 1.4, rel=1e-12)
    assert model.declared("k").bounds == (0.1, 1.5)
    assert table.parameters["k"].start == (0.2, 0.3, 0.4)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("count = 3", "counts = 3", "chamber.toml, [model]: Model 'chamber': the nodes of table 'k'"),
        ('unit = "bar/%"', 'units = "bar/%"', "did you mean 'unit'?"),
        ('over = ["u"]\nnodes = {', "nodes = {", "key 'model.tables.k.over' is missing"),
        ("bounds = [0.1, 1.5]", 'bounds = [0.1, "a"]', "parameters.k.bounds.1 = 'a' cannot be used"),
        ("value = [0, 1, 2, 4]", "value = [0, 1, true, 4]", "parameters.valve.value"),
        ("value = [0, 1, 2, 4]", "value = [0, 1, 2]", "table 'valve' has 4 nodes but a value (0.0, 1.0, 2.0)"),
    ],
)
def test_mistakes_in_a_study_file(old, new, words):
    assert old in STUDY
    with pytest.raises((SpecError, ModelError)) as caught:
        spec.model_of(spec.validated(STUDY.replace(old, new, 1), FILE), FILE)
    assert words in str(caught.value)
    assert "chamber.toml" in str(caught.value)
