import numpy as np
import pytest
from method_runs import made_run, two_methods

from plantfit.study.comparing.basins import optima
from plantfit.study.comparing.profiles import (
    best_costs,
    by_seconds,
    data_profile,
    ecdf,
    grid_of,
    hitting_times,
    leads,
    quartiles,
)
from plantfit.study.comparing.statistics import evaluations_to_target
from plantfit.study.comparing.targets import profile_targets, scale_of, targets

RUN = made_run("a", 0, [10, 20, 40, 100], [8.0, 4.0, 1.0, 1.0], seconds=2.0)


def test_hitting_times_are_those_of_the_single_function():
    runs = two_methods(6)
    wanted = [0.5, 0.1, 0.02, 0.0]
    found = hitting_times(runs, wanted)
    expected = [[evaluations_to_target(r.history_evaluations, r.history_cost, t) for t in wanted] for r in runs]
    assert found.tolist() == expected
    assert np.isinf(found[:, -1]).all()


def test_seconds_are_the_runs_seconds_shared_over_its_evaluations():
    assert hitting_times([RUN], [4.0, 1.0], by_seconds).tolist() == [[0.4, 0.8]]


def test_ecdf_counts_hits_only():
    assert ecdf(np.array([[10.0, np.inf], [30.0, 20.0]]), np.array([5.0, 10.0, 25.0, 1e9])).tolist() == [
        0.0,
        0.25,
        0.5,
        0.75,
    ]


def test_data_profile_divides_by_the_dimension():
    small, large = np.array([[30.0]]), np.array([[30.0]])
    assert data_profile([(small, 2), (large, 5)], np.array([4.9, 5.0, 10.0])).tolist() == [0.0, 0.5, 1.0]


def test_best_costs_are_steps_on_a_common_grid():
    grid = np.array([5.0, 10.0, 39.0, 40.0, 1000.0])
    assert best_costs([RUN], grid).tolist() == [[np.inf, 8.0, 4.0, 1.0, 1.0]]
    every = two_methods(3)
    grid = grid_of(every)
    assert len(grid) <= 200
    assert best_costs(every, grid)[:, -1].tolist() == [r.history_cost[-1] for r in every]


def test_quartiles_stand_failed_runs():
    costs = np.array([[1.0], [2.0], [3.0], [np.inf], [np.inf]])
    assert quartiles(costs).tolist() == [[2.0], [3.0], [np.inf]]


def test_the_lead_changes_where_medians_cross():
    grid = np.geomspace(10, 1000, 101)
    spread = np.linspace(0.98, 1.02, 9)[:, None]
    early, late = spread * grid**-0.5, spread * 10 * grid**-1.0  # equal at 100
    found = leads(("early", early), ("late", late), grid)
    assert [lead.method for lead in found] == ["early", "late"]
    assert found[1].start == pytest.approx(100, rel=0.06)
    assert leads(("a", early), ("b", early), grid) == []


def test_scale_from_random_search_else_from_the_start():
    runs = two_methods(5)
    scale = scale_of(runs)
    assert scale
    assert scale.best == min(r.cost for r in runs)
    assert scale.reference == np.median([r.history_cost[0] for r in runs])
    random = [made_run("random", k, [1, 100], [9.0, 3.0 + k]) for k in range(3)]
    with_random = scale_of([*runs, *random])
    assert with_random
    assert (with_random.reference, with_random.source) == (4.0, "median of random search")
    known = scale_of(runs, optimum=-1.0)
    assert known
    assert (known.best, known.known) == (-1.0, True)
    assert scale_of([made_run("a", 0, [1], [np.nan])]) is None


def test_targets_in_their_order_and_only_as_fine_as_costs_can_be_told_apart():
    scale = scale_of([made_run("random", 0, [1, 9], [200.0, 101.0]), made_run("a", 0, [1, 9], [200.0, 1.0])])
    assert scale
    found = targets(scale, asked=[7.0], floor=1.5)
    assert [t.label for t in found] == ["asked for", "noise floor", *(f"10^-{k}" for k in range(1, 9))]
    assert [t.cost for t in found[:5]] == pytest.approx([7.0, 1.5, 11.0, 2.0, 1.1])
    assert len(profile_targets(scale)) == 41
    assert targets(None, asked=[7.0])[0].cost == 7.0
    coarse = scale_of([made_run("random", 0, [1], [1 + 5e-10]), made_run("a", 0, [1], [1.0])])
    assert [t.label for t in targets(coarse)] == ["10^-1", "10^-2"]


def test_optima_of_one_cost_are_told_apart_by_their_place():
    costs = [1.0, 1.001, 1.0, 1.002, 5.0, np.inf]
    x = [[0.2, 0.2], [0.22, 0.2], [0.8, 0.8], [0.24, 0.21], [0.5, 0.5], [0.2, 0.2]]
    found = optima(costs, x, within=0.01)
    assert [g.members for g in found] == [(0, 1, 3), (2,)]
    assert found[0].share == 0.5
    assert found[0].spread == pytest.approx([0.04, 0.01])
    assert optima([np.nan], [[0.5]], within=1.0) == []


def test_a_valley_is_one_answer_with_a_wide_spread():
    x = np.stack([np.linspace(0, 1, 60), np.full(60, 0.5)], axis=1)
    found = optima(np.ones(60), np.random.default_rng(0).permutation(x), within=0.0)
    assert len(found) == 1
    assert found[0].spread == pytest.approx([1.0, 0.0])
