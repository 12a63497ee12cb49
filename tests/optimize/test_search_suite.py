"""The suite of multimodal problems: its truths are true, its judge sees false statements, and `auto` finds the
optimum of a few."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.search_suite import judge as judge_module
from benchmarks.search_suite import nist, table, truths
from benchmarks.search_suite.descents import descend, descend_many
from benchmarks.search_suite.judge import Watch, judge
from benchmarks.search_suite.suite import CASES, WRITTEN

from plantfit.study.objective import objective_of

TRUTHS = truths.load()
ALONE = {"agree": 1, "side_by_side": 1}
FAST = ("runout", "thin film", "stribeck curve")  # compiled and searched in seconds


def cube(name: str, values) -> np.ndarray:
    space = CASES[name].problem().space
    return space.cube(space.vector(values))


def test_every_problem_is_certified_as_hard():
    assert set(TRUTHS) <= set(WRITTEN)
    assert len(CASES) >= 40
    for name, truth in TRUTHS.items():
        assert truth.trust_region.starts >= 200, name
        assert truth.trust_region.most < truths.ENOUGH, name
        assert truth.levenberg_marquardt.starts >= 1000, name
        # an optimum that was reached only once might not be the best
        assert truth.levenberg_marquardt.reached + truth.trust_region.reached >= 3, name
        assert truth.evolution["cost"] >= truth.cost * (1 - truths.SAME), name


@pytest.mark.parametrize("name", FAST)
def test_certified_optimum_is_one_and_below_the_truth(name):
    problem, truth = CASES[name].problem(), TRUTHS[name]
    z = cube(name, truth.point)
    assert float(problem.costs(z[None])[0]) == pytest.approx(truth.cost, rel=1e-9)
    assert descend(problem, z).cost == pytest.approx(truth.cost, rel=1e-9)
    at_truth = float(problem.costs(cube(name, CASES[name].truth)[None])[0])
    assert truth.cost <= at_truth == pytest.approx(truth.truth_cost)
    assert truth.cost > 0.7 * at_truth  # d parameters take about d/m of the noise away


def test_truth_is_nowhere_special():
    for case in WRITTEN.values():
        for name, value in case.truth.items():
            p = case.parameters[name.split("[")[0]]
            low, high = (float(np.min(b)) for b in p.bounds or ())
            share = (value - low) / (high - low)
            assert all(abs(share - s) > 5e-4 for s in (0.0, 0.5, 1.0)), (case.name, name)


def test_both_local_searches_end_alike_beside_the_optimum():
    problem, truth = CASES["thin film"].problem(), TRUTHS["thin film"]
    rng = np.random.default_rng(3)
    starts = cube("thin film", truth.point) + 0.003 * rng.standard_normal((20, problem.space.dimension))
    _, costs = descend_many(problem, np.clip(starts, 0, 1))
    np.testing.assert_allclose(costs, truth.cost, rtol=1e-9)
    np.testing.assert_allclose([descend(problem, s).cost for s in starts[:5]], truth.cost, rtol=1e-9)


def test_judge_sees_an_answer_that_is_no_optimum():
    problem, truth = CASES["runout"].problem(), TRUTHS["runout"]
    # one generation of a swarm ends nowhere
    verdict = judge(problem, truth, 0, method="pso", budget=200)
    assert not verdict.found
    assert verdict.unfinished


def test_judge_sees_searches_that_stopped_midway(monkeypatch):
    problem, truth = CASES["runout"].problem(), TRUTHS["runout"]

    def stopped(objective, *_, **__):
        projected = objective.projected()
        rows = [projected.rows(np.array([[0.3 + s, 0.4]])) for s in (0.0, 1e-11, 2e-11)]
        costs = [float(np.mean(r**2)) for r, *_ in rows]
        extra = {"basin_hits": 3, "starts": 3, "local_costs": costs}
        return [
            SimpleNamespace(
                cost=min(costs), x=rows[0][2][0], status="converged", extra=extra, evaluations=3.0, seconds=0.0
            )
        ]

    monkeypatch.setattr(judge_module, "minimise", stopped)
    verdict = judge(problem, truth, 0)
    assert verdict.false_convergence
    assert verdict.unfinished
    assert verdict.counted == verdict.rerun == verdict.stray == 3
    assert not verdict.miscounted


@pytest.mark.parametrize(("hits", "costs"), [(4, 3), (2, 3), (3, 4)])
def test_judge_counts_itself(monkeypatch, hits, costs):
    """More hits than ends, converged with too few, an end below the answer."""
    problem, truth = CASES["runout"].problem(), TRUTHS["runout"]
    listed = [truth.cost * 2, truth.cost * 2, truth.cost * 2, truth.cost][:costs]
    x = cube("runout", truth.point)
    extra = {"basin_hits": hits, "starts": 4, "local_costs": listed}
    told = SimpleNamespace(cost=truth.cost * 2, x=x, status="converged", extra=extra, evaluations=3.0, seconds=0.0)
    monkeypatch.setattr(judge_module, "minimise", lambda *_, **__: [told])
    assert judge(problem, truth, 0).miscounted


def test_watched_points_are_whole_and_have_their_cost():
    problem, watch = CASES["three phases"].problem(), Watch()
    objective = watch.objective(objective_of(problem))
    assert objective.projected is not None
    assert objective.batch_rows is not None
    projected = objective.projected()
    assert projected is not None
    zs = np.random.default_rng(5).random((4, problem.space.dimension))
    searched, whole = projected.rows(zs[:, projected.kept]), objective.batch_rows(zs)
    assert len(projected.kept) < problem.space.dimension
    for r in (searched[0], np.asarray(whole[0])):
        for cost in np.mean(r**2, axis=1):
            z = watch.at(float(cost))
            assert z is not None
            assert float(problem.costs(z[None])[0]) == pytest.approx(cost, rel=1e-9)
    assert watch.at(1e9) is None


def test_study_files_give_the_data_they_were_written_with():
    case = CASES["late ringing"]
    problem = case.problem()
    assert set(problem.experiments) == {"morning", "evening"}
    at_truth = float(problem.costs(problem.space.cube(problem.space.vector(case.truth))[None])[0])
    assert at_truth == pytest.approx(case.noise["y"] ** 2, rel=0.3)


def test_judge_sees_convergence_to_another_optimum():
    problem, truth = CASES["runout"].problem(), TRUTHS["runout"]
    # a single local search is its own agreement
    verdicts = [judge(problem, truth, seed, method="least_squares", settings=ALONE) for seed in range(4)]
    wrong = [v for v in verdicts if not v.found]
    assert wrong
    assert all(v.excess > 0.1 and not v.unfinished for v in wrong)
    # the same cost held against a certified optimum that it is
    own = dataclasses.replace(truth, cost=wrong[0].cost)
    assert judge(problem, own, wrong[0].seed, method="least_squares", settings=ALONE).found


def test_digits_of_nist_allow_exchange_and_signs():
    values = dict(nist.certified("Gauss1").values)
    assert nist.digits("Gauss1", values) == 16
    first, second = nist.TERMS["Gauss1"]
    exchanged = {**values, **{a: values[b] for a, b in zip(first + second, second + first, strict=True)}}
    exchanged["b5"] *= -1
    assert nist.digits("Gauss1", exchanged) == 16
    assert nist.digits("Gauss1", {**values, "b4": values["b4"] * 1.001}) == pytest.approx(3, abs=1e-6)
    assert nist.digits("BoxBOD", {n: -v for n, v in nist.certified("BoxBOD").values.items()}) < 0


@pytest.mark.parametrize("name", nist.FORMULAS)
def test_certified_values_explain_the_data_in_the_wide_box(name):
    known, problem = nist.certified(name), nist.problem_of(name, None)
    z = problem.space.cube(problem.space.vector(known.values))
    assert np.all((z > 0) & (z < 1))
    squares = float(problem.costs(z[None])[0]) * len(known.y)
    assert squares == pytest.approx(known.squares, rel=1e-6 if name != "Lanczos3" else 1e-3)


def test_tables_show_what_changed():
    problem, truth = CASES["thin film"].problem(), TRUTHS["thin film"]
    found = judge(problem, truth, 0)
    lines = table.suite_table([found, dataclasses.replace(found, seed=1, found=False, false_convergence=True)], TRUTHS)
    assert "50.0 %" in lines[-1]
    assert "0 of 1" in lines[-1]
    before, after = (
        {"suite": [dataclasses.asdict(dataclasses.replace(found, found=f))], "nist": []} for f in (False, True)
    )
    assert "0/1 -> 1/1" in table.change_table(before, after)[1]


@pytest.mark.parametrize(("name", "agree"), [("resonance line", 1), ("stribeck curve", 3)])
def test_auto_finds_the_optimum_of_a_few(name, agree):
    """The first has so many optima that the budget ends before a tenth of the box is unseen: it is not called
    converged."""
    verdict = judge(CASES[name].problem(), TRUTHS[name], 0)
    assert verdict.found
    assert verdict.status == ("converged" if agree >= 3 else "budget")
    told_wrong = verdict.false_convergence or verdict.unfinished or verdict.miscounted
    assert not told_wrong
    assert verdict.stray == 0
    assert verdict.rerun >= verdict.counted >= agree


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_auto_finds_the_optimum_and_tells_the_truth(name):
    verdicts = [judge(CASES[name].problem(), TRUTHS[name], seed) for seed in range(5)]
    assert not any(v.false_convergence or v.unfinished or v.miscounted or v.stray for v in verdicts), verdicts
    assert sum(v.found for v in verdicts) >= 4, verdicts
