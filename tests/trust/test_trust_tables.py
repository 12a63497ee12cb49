"""Parameters with many entries: their rows, their sentences, their covariance at full size."""

import functools
import json
import tracemalloc

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.fitting import Answer
from plantfit.models import Declared, Model, Table
from plantfit.optimize.contract import RunResult, Status
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.report import render_html, summary_text
from plantfit.space import Parameter
from plantfit.trust import covariance, flat_directions
from plantfit.trust.finish.descent import descent
from plantfit.trust.intervals.covariance import Block, normal_matrix
from plantfit.trust.verdict.all_sentences import sentences
from plantfit.trust.verdict.parameters import parameter_sentences

NODES = tuple(np.linspace(0.0, 20.0, 6).tolist())
TRUTH = np.array([1.0, 2.0, 1.5, 0.5, 1.0, 2.0])


def curve() -> Model:
    """y = f(u) + c g(u): a free table over u, a known one, and an offset."""
    free, known = Table("f", ("u",), (NODES,), "V"), Table("g", ("u",), ((0.0, 20.0),), None)
    return Model(
        name="curve",
        states={},
        inputs={"u": "bar"},
        outputs={"y": "V"},
        parameters=(
            Declared("f", "V", (0.0, 10.0), shape=free.shape),
            Declared("g", None, value=(0.0, 1.0), shape=known.shape),
            Declared("c", "V", (-5.0, 5.0)),
        ),
        output=lambda x, u, p: {
            "y": free(p["f"], u["u"]) + p["c"] * known(p["g"], u["u"]) * 0.0 + p["c"] * u["u"] ** 2 / 400.0
        },
        tables=(free, known),
    )


@functools.cache
def findings(names=("a", "b")):
    """Recordings that end at 11 bar: the upper nodes of the table are never visited."""
    rng, records = np.random.default_rng(0), {}
    for name in names:
        u = rng.uniform(0.0, 11.0, 300)
        y = np.interp(u, NODES, TRUTH) + 1.0 * u**2 / 400.0 + 0.02 * rng.normal(size=300)
        records[name] = Recording(np.arange(300.0), {"u": Signal(u, "bar"), "y": Signal(y, "V")}, name)
    problem = Problem(
        curve(),
        records,
        {"f": Parameter((0.0, 10.0), "V", per_recording=True, shape=(6,)), "c": Parameter((-5.0, 5.0), "V")},
    )
    tree = {c.name: (1.0 if c.parameter == "c" else TRUTH[c.index]) for c in problem.space.coordinates}
    z = problem.space.cube(problem.space.vector(tree))
    run = RunResult(
        "given", 0, 0, z, float(problem.costs(z[None])[0]), 1.0, 0.0, Status.converged, np.ones(1), np.ones(1)
    )
    return Answer(problem, [run], 0).findings


def test_rows_name_every_entry_and_fixed_tables_too():
    rows = {p["name"]: p for p in findings()["parameters"]}
    assert list(rows) == [*(f"f[{k}][{r}]" for r in "ab" for k in range(6)), "c", "g[0]", "g[1]"]
    assert (rows["g[1]"]["status"], rows["g[1]"]["value"], rows["g[1]"]["index"]) == ("fixed", 1.0, [1])
    assert (rows["f[2][b]"]["parameter"], rows["f[2][b]"]["recording"], rows["f[2][b]"]["index"]) == ("f", "b", [2])
    assert rows["c"]["index"] == []
    assert {rows[f"f[{k}][a]"]["status"] for k in (0, 1, 2)} == {"determined"}
    assert {rows[f"f[{k}][a]"]["status"] for k in (4, 5)} == {"not visited"}
    assert {rows[f"f[{k}][a]"][key] for k in (4, 5) for key in ("standard_error", "low", "high")} == {None}


def test_tables_of_the_record_hold_the_same_numbers_over_their_nodes():
    tables = {(t["name"], t["recording"]): t for t in findings()["tables"]}
    assert set(tables) == {("f", "a"), ("f", "b"), ("g", None)}
    table = tables["f", "b"]
    assert (table["over"], table["over_units"], table["nodes"], table["unit"]) == (["u"], ["bar"], [list(NODES)], "V")
    np.testing.assert_allclose(table["values"], TRUTH)
    rows = [p for p in findings()["parameters"] if p["parameter"] == "f" and p["recording"] == "b"]
    assert table["low"] == [p["low"] for p in rows]
    assert table["status"] == [p["status"] for p in rows]
    assert tables["g", None]["status"] == ["fixed", "fixed"]
    assert json.loads(json.dumps(findings())) == findings()


def test_a_table_has_one_sentence_that_counts_and_says_where():
    (said,) = [v["sentence"] for v in findings()["verdict"] if "table f" in v["sentence"]]
    assert "of 12 entries of table f are determined" in said
    assert "in a" in said
    assert "4 are never visited (2 in a and 2 in b)" in said
    (gap,) = [
        v for v in findings()["verdict"] if v["sentence"].startswith("f of a and b: u of 16 to 20 bar never visited")
    ]
    assert gap["figures"] == {"unvisited": 4.0}


def test_intervals_of_visited_entries_hold_the_truth():
    rows = [p for p in findings()["parameters"] if p["parameter"] == "f" and p["index"][0] < 3]
    assert all(p["low"] < TRUTH[p["index"][0]] < p["high"] for p in rows)
    assert all(p["standard_error"] < 0.06 for p in rows)


def test_report_and_text_take_the_record():
    page, text = render_html(findings()), summary_text(findings())
    assert "f over u" in page
    assert "All 12 entries of f" in page
    assert "f[3][a]" not in text


def test_more_recordings_do_not_make_more_sentences():
    ten = findings(tuple("abcdefghij"))
    assert len(ten["verdict"]) <= 12
    text = " ".join(v["sentence"] for v in ten["verdict"])
    assert "The model follows y of 10 recordings with an RMSE of" in text
    assert "of 60 entries of table f" in text
    assert max(len(v["sentence"]) for v in ten["verdict"]) < 500


def row(name, status, recording=None, index=(), value=1.0):
    return {
        "name": name, "parameter": name.split("[")[0], "recording": recording, "index": list(index), "unit": "s",
        "value": value,
        "standard_error": 0.1, "low": 0.8, "high": 1.2, "lower_bound": 0.0, "upper_bound": 2.0, "status": status,
        "at_bound": "upper" if status == "at bound" else None,
    }  # fmt: skip


@pytest.mark.parametrize("status", ["weak", "flat", "at bound"])
def test_many_values_of_one_parameter_share_a_sentence(status):
    few = [row(f"Td[r{k}]", status, f"r{k}") for k in range(3)]
    many = [row(f"Td[r{k}]", status, f"r{k}") for k in range(9)]
    assert len(list(parameter_sentences({"parameters": few}))) == 3
    (said,) = parameter_sentences({"parameters": many})
    assert "Td" in said["sentence"]
    assert "9 recordings (r0, r1, r2 and 6 more)" in said["sentence"]


def test_entries_of_one_recording_are_named():
    rows = [row(f"k[{k}]", "flat" if k > 2 else "determined", index=(k,)) for k in range(4)]
    said = [v["sentence"] for v in parameter_sentences({"parameters": rows})]
    assert said[-1] == "3 of 4 entries of table k are determined by the data; 1 is not determined (k[3])."


def test_all_entries_determined_is_good_news():
    rows = [row(f"k[{k}]", "determined", index=(k,)) for k in range(4)]
    assert [v["level"] for v in parameter_sentences({"parameters": rows})] == ["good", "good"]


def test_a_place_in_a_table_over_two_signals_names_both():
    rows = [
        row(f"k[{i},{j}]", "flat" if (i, j) == (1, 2) else "determined", index=(i, j))
        for i in range(3)
        for j in range(4)
    ]
    nodes = [[0.0, 5.0, 9.0], [10.0, 20.0, 30.0, 40.0]]
    table = {
        "name": "k",
        "over": ["y", "u"],
        "over_units": ["bar", "%"],
        "nodes": nodes,
        "status": [r["status"] for r in rows],
    }
    said = [v["sentence"] for v in parameter_sentences({"parameters": rows, "tables": [table]})][-1]
    assert said.endswith("The data tell too little at y of 5 bar and u of 30 %.")


def test_a_long_direction_is_said_in_short():
    rng = np.random.default_rng(0)
    weak = rng.normal(size=30)
    weak /= np.linalg.norm(weak)
    hessian = 1e4 * (np.eye(30) - np.outer(weak, weak))
    (direction,) = flat_directions(hessian, np.ones(30), np.full(30, 100.0), tuple(f"k[{i}]" for i in range(30)))
    assert len(direction.weights) <= 12
    assert len(direction.sentence) < 300
    assert direction.sentence.startswith(f"{len(direction.weights)} parameters can move together")


def test_values_that_are_open_alone_do_not_make_combinations():
    # 20 values without information, of one size, and a pair of which only the sum is known
    hessian = np.zeros((22, 22))
    hessian[20:, 20:] = 1e6
    directions = flat_directions(hessian, np.ones(22), np.full(22, 100.0), tuple(f"k[{i}]" for i in range(22)))
    assert sorted(len(d.weights) for d in directions) == [1] * 20 + [2]
    (pair,) = [d for d in directions if len(d.weights) == 2]
    assert set(pair.weights) == {"k[20]", "k[21]"}


def blocks_of(records, length, own, shared):
    """Jacobian of records with `own` coordinates each and `shared` ones, residuals, blocks."""
    rng = np.random.default_rng(1)
    jacobian = np.zeros((records * length, records * own + shared))
    for k in range(records):
        rows = slice(k * length, (k + 1) * length)
        jacobian[rows, k * own : (k + 1) * own] = rng.normal(size=(length, own))
        jacobian[rows, records * own :] = rng.normal(size=(length, shared))
    blocks = [Block(slice(k * length, (k + 1) * length), np.arange(length)) for k in range(records)]
    return jacobian, rng.normal(size=records * length), blocks


def test_block_by_block_equals_the_whole():
    jacobian, residuals, blocks = blocks_of(3, 200, 4, shared=2)
    free = np.ones(jacobian.shape[1], bool)
    # a tiny number in every place leaves no column of zeros to skip
    whole = covariance(jacobian + 1e-13, residuals, blocks, free)
    np.testing.assert_allclose(
        covariance(jacobian, residuals, blocks, free), whole, rtol=1e-9, atol=1e-12 * np.max(whole)
    )
    np.testing.assert_allclose(normal_matrix(jacobian, blocks), jacobian.T @ jacobian, rtol=1e-12, atol=1e-9)


def test_recordings_without_shared_parameters_do_not_see_each_other():
    jacobian, residuals, blocks = blocks_of(2, 300, 3, 0)
    both = covariance(jacobian, residuals, blocks, np.ones(6, bool))
    assert np.all(both[:3, 3:] == 0.0)


def test_ten_openings_of_the_steam_chamber_need_little_memory():
    jacobian, residuals, blocks = blocks_of(10, 2440, 31, 0)
    tracemalloc.start()
    result = covariance(jacobian, residuals, blocks, np.ones(310, bool))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.all(np.isfinite(result))
    assert peak < 2**28


def test_the_verdict_needs_no_table():
    bare = {key: value for key, value in findings().items() if key != "tables"}
    run = RunResult("given", 0, 0, np.zeros(1), 1.0, 1.0, 0.0, Status.converged, np.ones(1), np.ones(1))
    assert any("entries of table f" in v["sentence"] for v in sentences(bare, run))


def test_statuses_and_intervals_of_entries_do_not_depend_on_the_box():
    """Well known, roughly known, open and never visited entries: the same in a box 30 times as wide."""
    statuses, rows = _by_box(1.0)
    other, wider = _by_box(30.0)
    assert statuses == other == ["determined", "determined", "determined", "weak", "flat", "not visited"]
    for name in ("f[0]", "f[1]", "f[3]"):
        for key in ("low", "high", "standard_error"):
            assert wider[name][key] == pytest.approx(rows[name][key], rel=1e-4)
    assert (rows["f[4]"]["standard_error"], rows["f[4]"]["open"]) == (None, "both")
    assert 0.25 * TRUTH[3] < rows["f[3]"]["standard_error"] < 2 * TRUTH[3]  # no box makes it smaller


@functools.cache
def _by_box(width):
    """Statuses of the entries and rows by name: the node at 12 bar is seen by samples up to 9 bar, the one at 16 by
    one at 12.02."""
    u = np.concatenate([np.random.default_rng(1).uniform(0.0, 8.6, 300), [12.02]])
    y = np.interp(u, NODES, TRUTH) + u**2 / 400.0
    y += 0.05 * np.random.default_rng(2).normal(size=len(u))
    record = Recording(np.arange(len(u)) * 1.0, {"u": Signal(u, "bar"), "y": Signal(y, "V")}, "a")
    own = {"f": Parameter((-60.0 * width, 60.0 * width), "V", shape=(6,)), "c": Parameter(value=1.0, unit="V")}
    problem = Problem(curve(), {"a": record}, own)
    best = descent(problem, problem.space.cube(problem.space.vector({f"f[{k}]": v + 0.3 for k, v in enumerate(TRUTH)})))
    run = RunResult("given", 0, 0, best.z, best.cost, 1.0, 0.0, Status.converged, np.ones(1), np.ones(1))
    rows = {p["name"]: p for p in Answer(problem, [run], 0).findings["parameters"]}
    return [rows[f"f[{k}]"]["status"] for k in range(6)], rows
