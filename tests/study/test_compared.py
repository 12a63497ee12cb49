import json

import jsonschema
import numpy as np
import pytest
from method_runs import falling, made_run, two_methods
from scipy import stats

from plantfit.cli.terminal.out import plain
from plantfit.findings.results.all_results import result_schema
from plantfit.findings.results.methods_compared import ComparisonOfMethods
from plantfit.study.comparing.problem_runs import ProblemRuns
from plantfit.study.comparing.record import compared
from plantfit.study.comparing.statistics import summarise


def said(record, problem=0):
    return [s.sentence for s in record.problems[problem].sentences]


@pytest.fixture(scope="module")
def record():
    return compared([ProblemRuns("bench", tuple(two_methods(20)), ("p0", "p1", "p2"))])


def test_numbers_are_those_of_the_single_functions(record):
    problem, runs = record.problems[0], two_methods(20)
    costs = {m: [r.cost for r in runs if r.method == m] for m in ("early", "late")}
    assert [m.name for m in problem.methods] == ["early", "late"]
    assert problem.methods[1].cost.mean == summarise(costs["late"]).mean
    pair = problem.pairs[0]
    assert (pair.better, pair.worse, pair.a12) == ("late", "early", 1.0)
    assert pair.p == pytest.approx(stats.mannwhitneyu(costs["early"], costs["late"]).pvalue, rel=1e-6)
    assert pair.ratio == pytest.approx(np.median(costs["early"]) / np.median(costs["late"]))


def test_a_win_is_told_with_its_size_how_sure_and_when_it_turned(record):
    sentence = next(s for s in said(record) if "beats" in s)
    for words in (
        "late beats early",
        "100 % of pairs",
        "times lower",
        "A12, the share of pairs won, 1.00 (0.",
        "a large effect",
        "p < 0.0001",
        "20 and 20 runs",
    ):
        assert words in sentence
    assert "early is ahead up to about" in sentence
    assert sentence.endswith("evaluations, then late.")
    assert any("replicates are runs of one problem" in s for s in said(record))


def test_two_answers_of_one_cost_are_found(record):
    assert record.problems[0].optima.count >= 2
    assert any("distinct answers" in s for s in said(record))


def test_no_difference_says_what_would_have_been_seen():
    runs = [falling(m, k, 1.0) for m in ("one", "two") for k in range(12)]
    runs = [r if r.method == "one" else falling("two", r.run + 50, 1.0) for r in runs]
    sentence = next(s for s in said(compared([ProblemRuns("bench", tuple(runs))])) if "difference" in s)
    assert sentence.startswith("No difference between")
    assert "A12 above 0.83 would have been seen 8 times in 10" in sentence
    assert "beats" not in sentence


def test_differences_of_rounding_are_none():
    runs = [
        made_run(m, k, [10, 100], [1.0, 0.5 + e * (k + 1)])
        for m, e in (("one", 1e-13), ("two", 1e-11))
        for k in range(20)
    ]
    pair = compared([ProblemRuns("bench", tuple(runs))]).problems[0].pairs[0]
    assert (pair.a12, pair.p_holm, pair.differs) == (0.5, 1.0, False)


def test_a_method_that_often_fails_loses_and_is_counted():
    failing = [made_run("bad", k, [10, 100], [np.nan, np.nan] if k % 3 else [2.0, 0.5], x=[0.5] * 3) for k in range(15)]
    record = compared([ProblemRuns("bench", (*(falling("good", k, 1.0) for k in range(15)), *failing))])
    assert any("good beats bad" in s and "the median run of bad failed" in s for s in said(record))
    assert any("bad 10) rank last" in s for s in said(record))
    assert record.problems[0].methods[1].cost.failed == 10


def test_targets_asked_for_come_first_with_rate_and_time():
    record = compared([ProblemRuns("bench", tuple(two_methods(20)), floor=0.012)], asked=[0.05])
    problem = record.problems[0]
    assert [t.label for t in problem.targets[:3]] == ["asked for", "noise floor", "10^-1"]
    assert problem.main_target == 0
    late = problem.targets[0].methods["late"]
    assert late.ert_interval[0] <= late.ert <= late.ert_interval[1]
    assert any("Cost 0.05 (asked for) is reached by" in s for s in said(record))


def test_unequal_budgets_and_few_runs_are_cautioned():
    record = compared([ProblemRuns("bench", tuple(two_methods(4)), budgets={"early": 2000.0, "late": 500.0})])
    assert any("The budgets differ (early 2000, late 500 evaluations)" in s for s in said(record))
    assert any("Few runs (early 4, late 4)" in s for s in said(record))


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_units_of_the_cost_do_not_matter(record, scale):
    runs = [
        made_run(r.method, r.run, r.history_evaluations, scale * r.history_cost, x=r.x, seconds=r.seconds)
        for r in two_methods(20)
    ]
    found = compared([ProblemRuns("bench", tuple(runs))]).problems[0]
    before = record.problems[0]
    assert found.pairs[0].ratio_interval == pytest.approx(before.pairs[0].ratio_interval)
    assert found.ecdf
    assert before.ecdf
    assert found.ecdf.methods["late"] == pytest.approx(before.ecdf.methods["late"], abs=1e-3)
    assert found.optima.count == before.optima.count


def test_one_method_and_one_run_and_no_history_stand():
    one = compared([ProblemRuns("bench", (made_run("a", 0, [5], [0.25]),))])
    assert "Only a ran here" in said(one)[0]
    assert one.problems[0].pairs == []
    nothing = compared([ProblemRuns("bench", tuple(made_run("a", k, [5], [np.inf]) for k in range(3)))])
    assert nothing.problems[0].methods[0].cost.n == 0


def test_what_is_printed_keeps_its_schema_leaves_curves_out_and_has_null_for_infinite_costs():
    failing = [made_run("bad", k, [10], [np.inf], x=[0.5] * 3) for k in range(12)]
    problems = [
        ProblemRuns(f"p{k}", (*(falling("good", j, 1.0, seed=k) for j in range(12)), *failing)) for k in range(2)
    ]
    found = compared(problems)
    first = found.problems[0]
    assert first.pairs[0].medians[1] == np.inf
    assert np.isnan(first.pairs[0].ratio)
    assert first.methods[0].sorted
    assert first.convergence["good"].at
    printed = json.loads(json.dumps(plain(found.printed(written={"report": "c.html"})), allow_nan=False))
    jsonschema.validate(printed, result_schema("compare --methods"))
    shown = printed["problems"][0]
    assert shown["pairs"][0]["medians"][1] is None
    assert shown["pairs"][0]["ratio"] is None
    assert not {"convergence", "convergence_seconds", "ecdf", "parallel"} & set(shown)
    assert "sorted" not in shown["methods"][0]
    assert "profile" not in printed["across"]
    again = ComparisonOfMethods(**printed)
    assert np.isnan(again.problems[0].pairs[0].ratio)  # what null can say


def test_the_record_does_not_grow_with_the_runs():
    small, large = (
        len(json.dumps(compared([ProblemRuns("bench", tuple(two_methods(n)))]).plain())) for n in (200, 500)
    )
    assert large < 1.15 * small


def test_over_problems_two_methods_are_compared_by_signed_ranks():
    problems = [ProblemRuns(f"p{k}", tuple(two_methods(8, seed=k, floor=10.0**-k))) for k in range(6)]
    across = compared(problems).across
    assert across
    assert (across.problems, across.friedman) == (6, None)
    assert across.pairs[0].p == pytest.approx(2 / 2**6)
    assert across.sentences[0].startswith("late beats early over 6 problems (mean A12")
    few = compared(problems[:4]).across
    assert few
    assert "4 problems cannot give a p below 0.12" in few.sentences[0]


def test_over_problems_more_methods_are_ranked():
    def of(seed):
        return (*two_methods(6, seed=seed), *(falling("third", k, 0.7, seed=seed) for k in range(6)))

    across = compared([ProblemRuns(f"p{k}", of(k)) for k in range(8)]).across
    assert across
    assert across.friedman
    assert across.friedman.best == "late"
    assert across.friedman.mean_ranks == {"early": 2.0, "late": 1.0, "third": 3.0}
    assert "after Holm late ranks better than" in across.sentences[0]
    assert [p.worse for p in across.pairs] == ["early", "third"]


@pytest.mark.thorough
def test_methods_that_did_not_run_everywhere_are_left_out_of_ranks():
    lone = ProblemRuns("p1", tuple(falling("early", k, 1.0) for k in range(6)))
    assert compared([ProblemRuns("p0", tuple(two_methods(6))), lone]).across is None
