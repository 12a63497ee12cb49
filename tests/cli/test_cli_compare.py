"""`plantfit compare` on stores made by hand, and on one that `plantfit run` made."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_call import call

from plantfit.errors import Status
from plantfit.optimize.contract import RunResult
from plantfit.study import Plan, Store

sys.path.append(str(Path(__file__).resolve().parents[1] / "study"))
from method_runs import falling

NAMES = ("p0", "p1", "p2")


def add_study(store, methods, *, runs=12, probe=b"", budget=2000, rates=(1.0, 2.0), extra=None, tasks=None):
    plan = Plan(name=f"bench{len(store.studies())}", methods=methods, runs=runs, budget=budget, chunk=runs)
    number = store.add(plan, spec_text=None, coordinates=NAMES, probe=probe)
    for _ in range(len(methods) if tasks is None else tasks):
        claim = store.claim(number, "me")
        made = [
            falling(claim.task.method, k, rates[methods.index(claim.task.method)], budget=budget) for k in range(runs)
        ]
        results = [
            RunResult(
                r.method, r.run, 1, r.x, r.cost, r.evaluations, r.seconds, Status.budget, r.history_evaluations,
                r.history_cost,
                0, extra or {},
            )
            for r in made
        ]  # fmt: skip
        store.finish(claim, results, [dict(r.parameters) for r in made])
    store.settle(number, active=False)
    return number


def fingerprint(value):
    return np.array([value, value, value, 0.5], dtype="<f8").tobytes()


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Store.open("plantfit.db")


def test_the_newest_study_in_words_page_and_tables(store, capsys, monkeypatch, tmp_path):
    add_study(store, ("random",))
    add_study(store, ("random", "pso"))
    said = call(capsys, monkeypatch, "compare", "--latex", "t.tex", "--csv", "t.csv", "--target", "0.02")
    assert said.code == 0, said.err
    words = " ".join(said.out.split())
    assert "pso beats random" in words
    assert "Cost 0.02 (asked for)" in words
    assert "bench1" in words
    assert "bench0" not in words
    assert "pso beats random" in (tmp_path / "compare.html").read_text()
    assert "booktabs" in (tmp_path / "t.tex").read_text()
    assert (tmp_path / "t.csv").read_text().startswith("problem,method,runs,failed,best,worst,mean")


def test_json_is_one_value_without_curves(store, capsys, monkeypatch):
    add_study(store, ("random", "pso"), extra={"noise_floor": 0.015})
    said = call(capsys, monkeypatch, "compare", "1", "--json", "--out", "c.html")
    record = said.record("compare --methods")
    assert record["written"] == {"report": "c.html"}
    problem = record["problems"][0]
    assert problem["floor"] == 0.015
    assert problem["pairs"][0]["better"] == "pso"
    assert 0.5 < problem["pairs"][0]["a12"] <= 1
    assert "convergence" not in problem
    again = json.loads(call(capsys, monkeypatch, "compare", "1", "--json", "--floor", "0.02").out)
    assert again["problems"][0]["floor"] == 0.02
    assert again["problems"][0]["pairs"] == problem["pairs"]


def test_studies_of_one_problem_are_put_together_and_others_are_replicates(store, capsys, monkeypatch):
    first, second = fingerprint(1.0), fingerprint(2.0)
    add_study(store, ("random",), probe=first)
    add_study(store, ("random", "pso"), probe=first, budget=1000)
    add_study(store, ("random", "pso"), probe=second)
    record = json.loads(call(capsys, monkeypatch, "compare", "1", "2", "3", "--json").out)
    assert [p["studies"] for p in record["problems"]] == [[1, 2], [3]]
    assert [m["name"] for m in record["problems"][0]["methods"]] == ["random (study 1)", "random (study 2)", "pso"]
    assert any("budgets differ" in s["sentence"] for s in record["problems"][0]["sentences"])
    assert record["across"] is None
    both = json.loads(call(capsys, monkeypatch, "compare", "2", "3", "--json").out)
    assert both["across"]["methods"] == ["random", "pso"]
    assert "cannot give a p below" in both["across"]["sentences"][0]


def test_an_unfinished_study_is_compared_and_says_so(store, capsys, monkeypatch):
    add_study(store, ("random", "pso"), tasks=1)
    said = call(capsys, monkeypatch, "compare")
    assert said.code == 0
    assert "unfinished: 12 of 24 runs are compared" in " ".join(said.out.split())


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (("compare", "7"), 10, "has no study 7"),
        (("compare", "--store", "none.db"), 10, "none.db"),
        (("compare", "--target", "inf"), 8, "--target is inf; give a finite cost"),
        (("compare", "--out", "no/such/c.html"), 10, "does not exist; create it first"),
        (("compare", "--csv", "no/such/t.csv"), 12, "no/such/t.csv"),
    ],
)
def test_mistakes_are_one_sentence(store, capsys, monkeypatch, words, code, expected):
    add_study(store, ("random", "pso"), runs=3)
    said = call(capsys, monkeypatch, *words)
    assert said.code == code
    assert expected in said.err
    assert "Traceback" not in said.err


def test_empty_stores_and_studies_without_runs(store, capsys, monkeypatch):
    said = call(capsys, monkeypatch, "compare")
    assert (said.code, "holds no study" in said.err) == (10, True)
    add_study(store, ("random",), tasks=0)
    said = call(capsys, monkeypatch, "compare")
    assert (said.code, "has no finished run yet" in said.err) == (10, True)
