"""Tuning: dials, races, traced settings, the verdict, and the whole."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from scipy import stats

from plantfit.errors import SearchError
from plantfit.optimize import Objective, make, minimise
from plantfit.optimize.contract import Facts
from plantfit.optimize.loop.many_settings import Job, Sweep
from plantfit.optimize.registry import REGISTRY
from plantfit.study.tuning.dials import Dial, dials_of
from plantfit.study.tuning.outcome import Contest, Finish, Tuned, contest, finish, ratio_interval
from plantfit.study.tuning.racing import blocks, race, surely_worse
from plantfit.study.tuning.tuner import tune
from plantfit.testing.objectives import bowl

import jax.numpy as jnp

FACTS = Facts(3, 600, np.zeros(3), np.ones(3))


# dials


@pytest.mark.parametrize("method", sorted(REGISTRY))
@pytest.mark.further(2)
def test_a_dial_reaches_its_ends_and_its_default(method):
    dials = dials_of(method, FACTS).dials
    for dial in dials:
        assert dial.value(dial.place(dial.default)) == dial.default, dial
        values = [dial.value(z) for z in np.linspace(0, 1, 101)]
        if dial.levels:
            assert set(values) == set(dial.levels)
        else:
            assert (values[0], values[-1]) == pytest.approx((dial.low, dial.high))
            assert values == sorted(values)
        make(method, **{dial.name: values[0]})  # allowed ends
        make(method, **{dial.name: values[-1]})


def test_scales_and_slices():
    decades = Dial("sigma", 0.3, low=1e-4, high=1.0, log=True)
    assert [decades.value(z) for z in (0, 0.25, 0.5, 1)] == pytest.approx([1e-4, 1e-3, 1e-2, 1])
    counted = Dial("restarts", 9, low=0, high=999, log=True, whole=True)
    assert [counted.value(z) for z in (0, 1 / 3, 1)] == [0, 9, 999]
    words = Dial("topology", "ring", levels=("global", "ring", "star"))
    assert [words.value(z) for z in (0, 0.33, 0.34, 0.67, 1)] == ["global", "global", "ring", "star", "star"]


def test_populations_leave_room_for_ten_generations_and_keep_the_choice_of_the_method():
    [dial] = dials_of("pso", FACTS, only=["population"]).dials
    assert dial.levels[0] is None
    assert max(dial.levels[1:]) <= 60
    [wide] = dials_of("pso", FACTS, ranges={"population": (50, 500)}, only=["population"]).dials
    assert wide.levels == (None, 50, 89, 159, 282, 500)


WRONG = [
    ({"only": ["inerta"]}, "Did you mean 'inertia'"),
    ({"ranges": {"inertia": (0.4, 2.0)}}, "within 0 to 1"),
    ({"ranges": {"inertia": (0.9, 0.4)}}, "must rise"),
    ({"ranges": {"inertia": ("low", "high")}}, "two numbers"),
    ({"ranges": {"population": (3.5, 20)}}, "whole numbers"),
    ({"ranges": {"topology": ("rign",)}}, "Did you mean 'ring'"),
    ({"only": ["inertia"], "ranges": {"social": (1, 2)}}, "not among those to tune"),
    ({"only": []}, "no setting"),
]


@pytest.mark.parametrize(("given", "said"), WRONG)
def test_wrong_names_and_ranges_are_one_sentence(given, said):
    with pytest.raises(SearchError, match=said):
        dials_of("pso", FACTS, **given)


# races


def conover(scores, level):
    """The same as a textbook writes it, with loops."""
    k, n = len(scores), len(scores[0])
    ranks = [[0.0] * n for _ in range(k)]
    for j in range(n):
        for i in range(k):
            below = sum(scores[other][j] < scores[i][j] for other in range(k))
            equal = sum(scores[other][j] == scores[i][j] for other in range(k))
            ranks[i][j] = below + (equal + 1) / 2
    if stats.friedmanchisquare(*scores).pvalue >= level:
        return [False] * k
    sums = [sum(r) for r in ranks]
    a, b = sum(r**2 for row in ranks for r in row), sum(s**2 for s in sums) / n
    error = np.sqrt(2 * n * max(a - b, 0.0) / ((n - 1) * (k - 1)))  # Conover 1999, eq. 5.8.6
    return [s - min(sums) > stats.t.ppf(1 - level / 2, (n - 1) * (k - 1)) * error for s in sums]


def test_friedman_and_its_comparisons_against_the_textbook_form():
    rng = np.random.default_rng(5)
    found = 0
    for k, n in itertools.product((3, 5, 9), (3, 5, 8)):
        for shift in (0.0, 1.0, 3.0):
            scores = np.round(rng.normal(size=(k, n)) + shift * np.arange(k)[:, None], 1)
            assert surely_worse(scores).tolist() == conover(scores.tolist(), 0.05)
            found += surely_worse(scores).sum()
    assert found > 20


def test_only_order_counts_and_failures_are_last():
    scores = np.random.default_rng(1).normal(size=(4, 8)) + np.array([0, 0, 2, 4])[:, None]
    assert surely_worse(np.exp(scores)).tolist() == surely_worse(scores).tolist()
    failed = np.where(np.arange(4)[:, None] == 3, np.inf, scores)
    assert surely_worse(failed)[3]
    assert surely_worse(scores[::-1]).tolist() == surely_worse(scores).tolist()[::-1]
    assert not surely_worse(np.ones((4, 8))).any()
    assert not surely_worse(np.full((2, 8), np.inf)).any()


def test_two_candidates_need_five_seeds_to_part():
    apart = np.array([np.arange(5.0), 10 + np.arange(5.0)])
    assert surely_worse(apart).tolist() == [False, True]
    assert surely_worse(apart[::-1]).tolist() == [True, False]
    assert not surely_worse(apart[:, :4]).any()  # 1/16 at best


@pytest.mark.parametrize("k", [2, 6])
def test_equal_candidates_are_seldom_parted(k):
    rng = np.random.default_rng(2)
    wrong = np.mean([surely_worse(rng.normal(size=(k, 8))).any() for _ in range(400)])
    assert wrong < (0.13 if k == 2 else 0.08)  # one-sided in either direction: twice 5 % for two


def test_blocks():
    assert blocks(20) == [3, 5, 8, 13, 20]
    assert blocks(4) == [3, 4]
    assert blocks(2) == [2]


def test_a_race_spends_its_seeds_on_what_may_be_best():
    rng = np.random.default_rng(3)
    levels = {"good": 0.0, "fair": 0.3, "bad": 3.0, "awful": 9.0, "best": -0.1}
    scores: dict[str, list[float]] = {k: [] for k in levels}
    scores["best"] = list(-0.1 + 0.2 * rng.normal(size=20))

    def measure(keys, upto):
        for k in keys:
            scores[k] += list(levels[k] + 0.2 * rng.normal(size=upto - len(scores[k])))

    dropped = race(["good", "fair", "bad", "awful", "bad"], scores, "best", measure, 20)
    assert {"bad", "awful"} <= dropped
    assert "best" not in dropped
    assert len(scores["good"]) == 20
    assert len(scores["awful"]) <= 5
    assert len(scores["bad"]) <= 8


# traced settings


def assert_same(objective, method, budget, draws, rel):
    """Swept runs end as compiled ones, to a relative difference `rel`; 0 for the same bits. The settings that were
    free."""
    facts = Facts(objective.dimension, budget)
    dials = dials_of(method, facts)
    free = [*dials.traced, *(name for name, _ in dials.options)]
    rng = np.random.default_rng(4)
    chosen = [{d.name: d.value(rng.random()) for d in dials.dials if d.name in free} for _ in range(draws)]
    methods = [make(method, **s) for s in chosen]
    sweep = Sweep(objective, make(method), dials.traced, dials.options, budget, 7)  # pyrefly: ignore[bad-argument-type]
    together = sweep.run([Job(sweep.values(m), run) for run in (2, 9) for m in methods])
    for m, (a, b) in zip(methods, zip(together[:draws], together[draws:], strict=True), strict=True):
        for outcome, run in ((a, 2), (b, 9)):
            [alone] = minimise(objective, m, first_run=run, budget=budget, seed=7)
            assert outcome.cost == pytest.approx(alone.cost, rel=rel, abs=0)
            assert outcome.history_evaluations[-1] == alone.evaluations
            if rel == 0:
                ours, theirs = (finish(r.cost, r.history_evaluations, r.history_cost) for r in (outcome, alone))
                assert ours == theirs
    return free


def test_traced_settings_have_the_bits_of_compiled_ones():
    free = assert_same(bowl(3), "pso", 300, 1, rel=0)
    assert free == ["inertia", "cognitive", "social", "max_velocity", "topology", "bounds"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [n for n, e in REGISTRY.items() if hasattr(e.kind, "ask") and not e.kind.needs.raw_box],
)
def test_traced_settings_of_every_method_differ_in_rounding_at_most(method):
    # a constant is folded into its neighbours where data is not: cmaes, elite_ga and sea round differently
    assert_same(bowl(3), method, 500, 2, rel=1e-6)


# the verdict


def runs(costs, reached=100.0):
    return [Finish(float(c), reached) for c in costs]


def test_a_run_counts_as_its_cost_and_the_way_there_breaks_ties():
    late = finish(1.0, np.array([10.0, 50.0, 90.0]), np.array([3.0, 1.0 + 1e-9, 1.0]))
    assert late == Finish(1.0, 50.0)
    assert Finish(1.0, 50.0).score(100) < Finish(1.0, 90.0).score(100) < Finish(1.00001, 1.0).score(100)
    assert Finish(-1.0, 50.0).score(100) < Finish(-1.0, 90.0).score(100)
    assert Finish(0.0, 50.0).score(100) < Finish(0.0, 90.0).score(100)
    assert finish(np.inf, np.array([]), np.array([])).score(100) == np.inf


def test_contest_against_scipy_and_in_any_unit():
    rng = np.random.default_rng(6)
    a, b = np.exp(rng.normal(size=25)), np.exp(rng.normal(0.9, size=25))
    c = contest(runs(a), runs(b), 100, 1)
    u = stats.mannwhitneyu(b, a)
    assert c.a12 == pytest.approx(u.statistic / 625)
    assert c.p == pytest.approx(u.pvalue, rel=1e-6)
    assert c.ratio == pytest.approx(np.median(b) / np.median(a))
    assert c.ratio_interval[0] < c.ratio < c.ratio_interval[1]
    scaled = contest(runs(1e6 * a), runs(1e6 * b), 100, 1)
    assert scaled.ratio_interval == pytest.approx(c.ratio_interval)
    assert scaled.a12 == c.a12


def test_the_interval_of_the_ratio_covers_the_truth():
    rng = np.random.default_rng(8)
    hits = 0
    for k in range(100):
        low, high = ratio_interval(2 * np.exp(rng.normal(size=20)), np.exp(rng.normal(size=20)), seed=k, resamples=500)
        hits += low <= 2 <= high
    assert hits >= 90


def told(c: Contest | None, **more) -> Tuned:
    trials: Any = [None]
    plain = Tuned(
        "pso", "random", {"inertia": 0.5}, {"inertia": 0.7}, [], trials, c, False, 100, 1, (0, 19), (20, 39), 0.0, 0.0
    )
    return dataclasses.replace(plain, **more)


def test_sentences_say_whether_it_paid():
    rng = np.random.default_rng(9)
    low, high = np.exp(rng.normal(size=20)), np.exp(rng.normal(1.5, size=20))
    better, worse = (told(contest(runs(a), runs(b), 100, 1)) for a, b in ((low, high), (high, low)))
    assert better.pays
    assert "times lower than the default" in better.sentence
    assert better.sentence.endswith("use it.")
    slight = told(contest(runs(1.0 + 1e-4 * low / high.max()), runs(1.002 + 1e-4 * high / high.max()), 100, 1))
    assert "ends 0.2 % lower than the default (95 % interval 0.2 to 0.2" in slight.sentence
    assert "\ninertia = 0.5\n" in better.toml()
    assert not worse.pays
    assert "times higher" in worse.sentence
    assert "keep the default" in worse.sentence
    assert "\n# inertia = 0.5\n" in worse.toml()
    same = told(contest(runs(low), runs(low[::-1]), 100, 1))
    assert same.sentence.startswith("No gain beyond chance")
    faster = told(contest(runs(np.ones(20), 40), runs(np.ones(20), 80), 100, 1))
    assert faster.pays
    assert "same cost as the default with 2 times fewer evaluations" in faster.sentence
    failing = told(contest(runs(low), runs(np.full(20, np.inf)), 100, 1))
    assert failing.pays
    assert "inf" in failing.sentence
    hopeless = told(contest(runs(np.full(20, np.inf), np.inf), runs(np.full(20, np.inf), np.inf), 100, 1))
    assert "ends at the same cost as the default (A12 0.50, p 1," in hopeless.sentence
    assert "keep the default" in told(None).sentence
    assert "not yet compared" in told(None, interrupted=True).sentence


# the whole


def steep(x):
    return jnp.sum((x - 0.37) ** 2 * jnp.array([1.0, 30.0]), axis=1)


STEEP = Objective(2, steep)
SMALL = {"only": ["inertia", "topology"], "budget": 360, "runs": 8, "trials": 20, "seed": 3}


@pytest.fixture(scope="module")
def tuned():
    heard = []
    found = tune(STEEP, "pso", "pso", **SMALL, progress=heard.append)
    return found, heard


def test_a_small_budget_wants_less_inertia(tuned):
    found, _ = tuned
    assert found.pays, found.sentence
    assert found.contest is not None
    assert found.contest.ratio > 10
    assert found.best["inertia"] < 0.65
    assert found.trials[0].settings == found.default == {"inertia": 0.72984, "topology": "global"}
    assert 3 < len(found.trials) <= 20
    assert sum(t.runs for t in found.trials) < 8 * len(found.trials)  # some left early
    assert all((t.runs == 8) or t.dropped for t in found.trials)


def test_what_is_chosen_is_compared_on_other_seeds(tuned):
    found, _ = tuned
    assert not set(range(*found.search_runs)) & set(range(*found.fresh_runs))
    first, last = found.fresh_runs
    again = minimise(STEEP, "pso", runs=last - first + 1, first_run=first, budget=360, seed=3, settings=found.best)
    assert found.contest is not None
    assert np.median([r.cost for r in again]) == found.contest.tuned_median
    searched = minimise(STEEP, "pso", runs=8, budget=360, seed=3, settings=found.best)
    assert np.median([r.cost for r in searched]) == min(t.median for t in found.trials if not t.dropped)


def test_progress_falls_to_zero(tuned):
    found, heard = tuned
    assert heard[-1].seconds_left == 0
    assert heard[-1].evaluations == found.evaluations
    assert [p.runs_done for p in heard] == sorted(p.runs_done for p in heard)
    assert all(b.best <= a.best for a, b in itertools.pairwise(heard))


def test_same_seed_same_answer_and_a_stop_keeps_the_best(tuned):
    found, _ = tuned
    again = tune(STEEP, "pso", "pso", **SMALL)
    assert dataclasses.replace(again, seconds=0.0) == dataclasses.replace(found, seconds=0.0)
    calls = itertools.count()
    stopped = tune(STEEP, "pso", "pso", **SMALL, stop=lambda: next(calls) > 30)
    assert stopped.interrupted
    assert stopped.contest is None
    assert 0 < len(stopped.trials) < len(found.trials)
    assert stopped.trials[0] == found.trials[0]
    nothing = tune(STEEP, "pso", "pso", **SMALL, stop=lambda: True)
    assert nothing.best == nothing.default
    assert "nothing was learnt" in nothing.sentence


def test_host_methods_inside_and_outside():
    found = tune(bowl(2), "lbfgsb", "auto", budget=60, runs=3, trials=6, seed=2)
    assert found.trials[0].runs == 3
    assert np.isfinite(found.trials[0].median)
    assert len(found.trials) > 1


REFUSED = [
    ({"method": "psso"}, "Did you mean 'pso'"),
    ({"outer": "lbfgsb"}, "needs a gradient"),
    ({"outer": "cma"}, "no method 'cma'"),
    ({"trials": 1}, "trials is 1"),
    ({"trials": 4, "outer": "pso", "outer_settings": {"population": 30}}, "asks for 30 settings at a time"),
    ({"runs": 0}, "runs is 0"),
    ({"budget": 3, "only": ["inertia"]}, "budget"),
]


@pytest.mark.parametrize(("given", "said"), REFUSED)
def test_refusals_are_one_sentence(given, said):
    asked: dict[str, Any] = {"method": "pso", **given}
    with pytest.raises(SearchError, match=said):
        tune(STEEP, **asked)


def test_a_word_may_make_a_shape_of_a_number():
    """cga reads `children` in steady state alone, where it is the size of a generation: it is not data under any
    word."""
    dials = dials_of("cga", FACTS, only=["children", "replacement", "alpha"])
    assert "children" not in dials.traced
    assert "alpha" in dials.traced


@pytest.mark.thorough
def test_held_settings_keep_their_value_in_every_trial():
    found = tune(
        bowl(2), "pso", "random", only=["inertia"], held={"population": 7}, budget=140, runs=3, trials=6, seed=2
    )
    assert found.default["population"] == found.best["population"] == 7
    assert {t.settings["population"] for t in found.trials} == {7}
    assert [d["name"] for d in found.dials] == ["inertia"]
    with pytest.raises(SearchError, match="held and also to be tuned"):
        dials_of("pso", FACTS, only=["inertia"], held={"inertia": 0.5})
