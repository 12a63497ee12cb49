"""The loop: progress, stops, warm starts, groups of runs, checkpoints."""

import dataclasses
import itertools

import numpy as np
import pytest

from plantfit.errors import SearchError, Status
from plantfit.optimize import Checkpoint, Facts, Objective, minimise
from plantfit.optimize.algorithms.random_search import RandomSearch
from plantfit.optimize.loop import population_loop as loop
from plantfit.optimize.loop.counter import Counter
from plantfit.optimize.loop.generations import program
from plantfit.testing.objectives import bowl, centre, corner

import jax

PLAIN = ("run", "x", "cost", "evaluations", "status", "history_evaluations", "history_cost")


def same(a, b):
    return len(a) == len(b) and all(
        np.array_equal(getattr(p, n), getattr(q, n)) for p, q in zip(a, b, strict=True) for n in PLAIN
    )


@pytest.mark.parametrize("method", ["pso", "lbfgsb"])
def test_progress_ends_complete(method):
    seen = []
    results = minimise(bowl(3), method, runs=2, budget=300, seed=1, progress=seen.append)
    last = seen[-1]
    assert (last.runs_done, last.runs, last.budget_total) == (2, 2, 600.0)
    assert last.evaluations == sum(r.evaluations for r in results)
    assert last.best == min(r.cost for r in results)
    assert last.seconds_left == 0.0
    assert all(a.evaluations <= b.evaluations for a, b in itertools.pairwise(seen))


@pytest.mark.parametrize("method", ["pso", "cmaes", "lbfgsb", "least_squares", "auto"])
def test_target(method):
    [r] = minimise(bowl(3), method, budget=3000, seed=1, target=1e-3)
    assert r.status is Status.target
    assert r.cost <= 1e-3
    assert r.evaluations < 3000


def test_stagnation_stops_each_run_by_itself():
    results = minimise(bowl(3), "random", runs=4, budget=20_000, seed=1, stagnation=1000)
    assert {r.status for r in results} == {Status.stagnated}
    assert len({r.evaluations for r in results}) > 1
    for r in results:
        assert 1000 <= r.evaluations - r.history_evaluations[-2] < 1000 + 64


@pytest.mark.parametrize("method", ["random", "pso", "cmaes", "lbfgsb", "least_squares", "auto"])
def test_warm_start_is_used(method):
    start = centre(3)[None]
    [r] = minimise(dataclasses.replace(bowl(3), start=start), method, budget=100, seed=1)
    assert r.cost < 1e-12


def test_groups_and_blocks_do_not_matter(monkeypatch):
    whole = minimise(corner(3), "pso", runs=5, budget=600, seed=7)
    monkeypatch.setattr(loop, "SIDE_BY_SIDE", 26)
    monkeypatch.setattr(loop, "REPORT_SECONDS", 0.0)
    assert same(whole, minimise(corner(3), "pso", runs=5, budget=600, seed=7))


def test_checkpoint_of_another_search_is_refused():
    kept = []
    minimise(bowl(3), "random", budget=200, seed=1, checkpoint=kept.append)
    with pytest.raises(SearchError, match="another search"):
        minimise(bowl(3), "random", budget=200, seed=2, resume=kept[-1])


@pytest.mark.parametrize("cut", [0, 10, 200])
def test_damaged_checkpoint(cut):
    kept = []
    minimise(bowl(3), "random", budget=200, seed=1, checkpoint=kept.append)
    data = kept[-1].to_bytes()
    with pytest.raises(SearchError, match="cannot be read"):
        Checkpoint.from_bytes(data[:cut])


def test_stopped_before_the_start_returns_what_there_is():
    for method in ("pso", "lbfgsb"):
        results = minimise(bowl(3), method, runs=3, budget=300, stop=lambda: True)
        assert {r.status for r in results} == {Status.interrupted}
        assert all(r.evaluations == 0 and r.cost == np.inf for r in results)


def test_the_beginning_of_runs_is_traced_once_for_the_same_numbers_and_anew_for_others():
    method, cost, box = RandomSearch(), bowl(3), np.ones(3)
    facts = Facts(3, 300, -box, box, np.full((1, 3), 0.25))
    begin = program(cost, method, facts).begin
    assert program(cost, method, Facts(3, 300, -box, box.copy(), np.full((1, 3), 0.25))).begin is begin
    others = (Facts(3, 301, -box, box, facts.start), facts._replace(upper=2 * box), facts._replace(start=None),
              facts._replace(start=np.full((1, 3), 0.5)), facts._replace(start=np.full((3, 1), 0.25)))  # fmt: skip
    assert all(program(cost, method, other).begin is not begin for other in others)


@pytest.mark.parametrize(
    ("points", "widths"),
    [
        (1, [16]),
        (16, [16]),
        (17, [32]),
        (21, [32]),
        (40, [32, 16]),
        (49, [64]),
        (64, [64]),
        (85, [64, 32]),
        (500, [64] * 8),
    ],
)
def test_points_are_evaluated_in_few_calls_with_little_filling(points, widths):
    seen = []

    class Noted:
        lower = None  # as of a function that is compiled already

        def __call__(self, x):
            seen.append(len(x))
            return np.sum(x**2, axis=1)

    counter = Counter(Objective(2, Noted()), 10**6)
    x = np.random.default_rng(0).random((points, 2))
    assert np.array_equal(counter.costs(x), np.sum(x**2, axis=1))
    assert seen == widths


def test_keys_of_runs_are_folded_in_one_by_one():
    key, runs = jax.random.key(2**40 + 3), np.arange(4, 9, dtype=np.uint32)
    found = jax.random.key_data(loop._keys()(key, runs))
    assert np.array_equal(found, [jax.random.key_data(jax.random.fold_in(key, int(r))) for r in runs])
