"""Visits of tables against counts made by hand, and what the record and the verdict say of entries without any."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.fitting import fit
from plantfit.models import Table, equations, steam_chamber
from plantfit.problem import Experiment, Problem
from plantfit.problem.measure.operating_points import hat_weights, operating_points
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.trust.identify.table_visits import table_visits, unvisited
from plantfit.trust.verdict.tables import table_sentences

OWN = {n: Parameter(per_recording=True) for n in ("k", "A1", "A2", "Td")}


def record(opening, seconds=40.0):
    """A step of the valve; the pressures are not used, only where the model goes."""
    t = np.arange(0.0, seconds, 0.5)
    return Experiment(
        Recording(t, {"u": Signal(np.full(len(t), opening), "%"), "y": Signal(np.zeros(len(t)), "bar")}, "r"),
        before={"u": 0.0},
    )


def at(problem, k):
    named = {"k": k, "A1": 8.0, "A2": 4.0, "Td": 0.6}
    return np.array([named[c.parameter] for c in problem.space.coordinates])


def test_weights_of_one_axis_are_those_of_linear_interpolation():
    nodes, rng = (0.0, 1.0, 4.0, 5.0), np.random.default_rng(1)
    table, values = Table("f", ("s",), (nodes,)), rng.normal(size=4)
    s = np.r_[rng.uniform(-2.0, 7.0, 200), 0.0, 1.0, 5.0]
    weights = hat_weights(table, {"s": s})
    np.testing.assert_allclose(weights @ values, np.interp(s, nodes, values), rtol=1e-13)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert np.count_nonzero(weights, axis=1).max() == 2


def test_weights_of_two_axes_give_the_value_of_the_table():
    rng = np.random.default_rng(2)
    table = Table("f", ("y", "u"), ((0.0, 2.0, 3.0), (0.0, 50.0, 70.0, 100.0)))
    values, y, u = rng.normal(size=(3, 4)), rng.uniform(-1.0, 4.0, 100), rng.uniform(-10.0, 120.0, 100)
    weights = hat_weights(table, {"y": y, "u": u})
    np.testing.assert_allclose(np.einsum("nij,ij->n", weights, values), np.asarray(table(values, y, u)), rtol=1e-12)


def test_a_point_that_is_not_finite_has_no_weight():
    weights = hat_weights(Table("f", ("s",), ((0.0, 1.0),)), {"s": np.array([np.nan, 0.25])})
    np.testing.assert_allclose(weights, [[0.0, 0.0], [0.75, 0.25]])


def test_every_recording_counts_its_own_way_through_its_tables():
    problem = Problem(steam_chamber(), {"low": record(10.0), "high": record(60.0, 55.0)}, OWN, substeps=1)
    values = at(problem, 0.2)
    visits = {(v.table.name, v.recording): v for v in table_visits(problem, values)}
    assert set(visits) == {(n, r) for n in ("k", "A1", "A2") for r in ("low", "high")}
    for name, end in (("low", 2.0), ("high", 12.0)):
        v, y = visits["k", name], problem.predict(values, name)["y"]
        assert end * 0.9 < y.max() < end * 1.1
        cell = np.clip(np.floor(y / (20.0 / 9.0)).astype(int), 0, 8)
        np.testing.assert_allclose(operating_points(problem, values)[name]["x1"], y, rtol=1e-12)
        assert v.total == len(y)
        assert v.weight.sum() == pytest.approx(len(y))
        assert v.share.sum() == pytest.approx(1.0)
        np.testing.assert_array_equal(np.flatnonzero(v.visited), np.arange(cell.max() + 2))
        assert v.samples[0] == np.sum(cell == 0)
    gone = unvisited(list(visits.values()))
    assert "k[2][low]" in gone
    assert "k[1][low]" not in gone
    assert len(gone) == 3 * (8 + 3)


def test_entries_that_recordings_share_add_their_samples_up():
    problem = Problem(
        steam_chamber(opening_nodes=[10.0, 35.0, 60.0]), {"low": record(10.0), "high": record(60.0)}, substeps=1
    )
    (k, *_) = table_visits(problem, at(problem, 0.2))
    assert (k.recording, k.total, k.weight.shape) == (None, 160, (10, 3))
    assert k.weight.sum() == pytest.approx(160.0)
    assert not k.visited[:, 1].any()  # neither opening is near 35 %
    np.testing.assert_array_equal(k.visited[:, 2], k.visited[:, 2] & (np.arange(10) < 7))


def test_what_no_sample_depends_on_has_no_derivative():
    problem = Problem(steam_chamber(), {"low": record(10.0), "high": record(60.0)}, OWN, substeps=1)
    values = at(problem, 0.2)
    _, jacobian = problem.residuals_and_jacobian(problem.space.cube(values))
    still = {n for n, column in zip(problem.space.names, jacobian.T, strict=True) if not np.any(column)}
    assert still == unvisited(table_visits(problem, values))


def test_a_model_without_tables_and_held_tables_have_no_visits():
    problem = Problem(steam_chamber(), record(10.0), {"k": 0.2, "A1": 8.0, "A2": 4.0}, substeps=1)
    assert table_visits(problem, np.array([0.5])) == []


def row(name, recording, status, nodes=((0.0, 5.0, 10.0),), over=("y",)):
    return {"name": name, "recording": recording, "over": list(over), "over_units": ["bar"] * len(over),
            "nodes": [list(n) for n in nodes], "status": status}  # fmt: skip


def test_gaps_are_said_once_for_all_tables_that_have_them():
    gone, seen = ["determined", "not visited", "not visited"], ["determined"] * 3
    rows = [row("k", "a", gone), row("A", "a", gone), row("k", "b", seen), row("A", "b", seen)]
    (said,) = table_sentences([], rows)
    assert said["sentence"].startswith("k and A of a: y of 5 to 10 bar never visited: their values are not measured")
    assert said["figures"] == {"unvisited": 4.0}


def test_gaps_at_both_ends_and_in_the_middle_of_two_signals():
    grid = np.full((3, 2), "determined", dtype=object)
    grid[0, :], grid[2, 1] = "not visited", "not visited"
    (said,) = table_sentences([], [row("k", None, list(grid.ravel()), ((0.0, 5.0, 10.0), (1.0, 2.0)), ("y", "u"))])
    assert said["sentence"].startswith("k: y of 0 bar and 1 more entry never visited")
    ends = ["not visited", "determined", "not visited"]
    (said,) = table_sentences([], [row("k", None, ends)])
    assert said["sentence"].startswith("k: y of 0 bar and 10 bar never visited")


def test_many_gaps_make_one_sentence():
    rows = [
        row("k", f"r{i}", ["determined"] * i + ["not visited"] * (10 - i), (tuple(range(10)),)) for i in range(1, 10)
    ]
    (said,) = table_sentences([], rows)
    assert said["figures"]["unvisited"] == 45
    assert "and 4 more such gaps" in said["sentence"]


def test_a_table_read_at_an_expression_of_its_signal_is_not_misjudged():
    u = np.linspace(0.0, 4.0, 60)
    model = equations(
        "y = f(2*u)", inputs={"u": None}, outputs={"y": None},
        tables={"f": {"over": "u", "nodes": [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]}}, parameters={"f": {"bounds": (-2, 2)}},
    )  # fmt: skip
    y = np.sin(2 * u) + 0.05 * np.random.default_rng(0).normal(size=60)
    problem = Problem(model, Recording(np.arange(60.0), {"u": Signal(u), "y": Signal(y)}, "r"))
    findings = fit(problem, seed=1).findings
    assert [p["status"] == "not visited" for p in findings["parameters"]] == [False] * 5 + [True]
    assert findings["tables"][0]["samples"] is None
