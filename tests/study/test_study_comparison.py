import numpy as np
import pytest
from scipy import stats

from plantfit.study import a12, compare, holm
from plantfit.study.comparing.pairwise import a12_interval, detectable, effect_word, hitting_order, levels, mann_whitney

RNG = np.random.default_rng(8)
A, B, C = RNG.normal(size=20), RNG.normal(0.8, size=25), RNG.normal(size=15)


def test_a12_by_counting_and_by_the_rank_sum():
    assert a12([1, 2, 3], [2]) == pytest.approx((0 + 0.5 + 1) / 3)
    u = stats.mannwhitneyu(A, B).statistic
    assert a12(A, B) == pytest.approx(u / (len(A) * len(B)), rel=1e-14)
    assert a12(A, B) + a12(B, A) == pytest.approx(1.0, rel=1e-14)
    assert a12(3 * A + 7, 3 * B + 7) == a12(A, B)
    assert np.isnan(a12([], A))


def test_holm_by_hand_and_in_any_order():
    # sorted 0.01, 0.02, 0.04: times 3, 2, 1 gives 0.03, 0.04, 0.04
    assert holm([0.04, 0.01, 0.02]) == pytest.approx([0.04, 0.03, 0.04])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_compare_against_scipy():
    found = {(c.first, c.second): c for c in compare({"a": A, "b": B, "c": C})}
    assert list(found) == [("a", "b"), ("a", "c"), ("b", "c")]
    assert found["a", "b"].p == pytest.approx(stats.mannwhitneyu(A, B).pvalue, rel=1e-6)
    assert [c.p_holm for c in found.values()] == holm([c.p for c in found.values()])
    assert found["a", "b"].a12 == a12(A, B) < 0.5


def test_failed_runs_rank_last_and_equal_runs_tell_nothing():
    worse = compare({"a": [1.0, 2.0, 3.0, 4.0], "b": [np.nan, np.inf, np.nan, np.inf]})[0]
    assert worse.a12 == 0.0
    assert worse.p < 0.05
    assert compare({"a": [1.0, 1.0], "b": [1.0, 1.0]})[0].p == 1.0
    assert compare({"a": [1.0], "b": []}) == []


def test_a12_interval_moves_with_its_methods_and_not_with_the_scale():
    low, high = a12_interval(A, B)
    assert low < a12(A, B) < high
    assert a12_interval(B, A) == pytest.approx((1 - high, 1 - low), abs=1e-12)
    assert a12_interval(5 * A - 3, 5 * B - 3) == pytest.approx((low, high), abs=1e-12)
    assert a12_interval(RNG.permutation(A), B) == pytest.approx((low, high), abs=1e-12)


def test_a12_interval_of_separated_equal_and_single_runs():
    low, high = a12_interval(np.arange(10.0) + 100, np.arange(10.0))
    assert high == 1.0
    assert 0.7 < low < 0.95
    low, high = a12_interval(np.ones(8), np.ones(8))
    assert low < 0.5 < high
    assert a12_interval([1.0], [2.0, 3.0]) == (0.0, 1.0)
    assert np.isnan(a12_interval([], [1.0])).all()


def test_detectable_agrees_with_the_power_of_the_test():
    rng = np.random.default_rng(1)
    shift = np.sqrt(2) * stats.norm.ppf(detectable(30, 30))
    seen = np.mean([mann_whitney(rng.normal(shift, 1, 30), rng.normal(0, 1, 30)) < 0.05 for _ in range(400)])
    assert 0.72 <= seen <= 0.88  # 0.80 by design, 0.02 scatter, Noether's formula is approximate
    assert detectable(1000, 1000) < detectable(30, 30) < detectable(30, 30, pairs=10) < 1
    assert detectable(2, 2) == 1.0


def test_effect_words():
    assert [effect_word(a) for a in (0.5, 0.57, 0.35, 0.72, 0.0)] == ["negligible", "small", "medium", "large", "large"]


def test_levels_join_costs_that_differ_by_rounding():
    found = levels({"a": [1.0, 2.0, np.nan], "b": [1.0 + 1e-9, 3.0, np.inf]}, 1e-6)
    assert found["a"].tolist() == [0, 1, 3]
    assert found["b"].tolist() == [0, 2, 3]
    floored = levels({"a": [1e-28, 1.0], "b": [3e-25]}, 1e-6, floor=1e-20)
    assert floored["a"][0] == floored["b"][0]


def test_misses_rank_behind_hits_by_their_final_cost():
    found = hitting_order(
        {"a": [300.0, np.inf], "b": [100.0, np.inf, np.inf]}, {"a": [0.1, 2.0], "b": [0.2, 1.0, np.nan]}
    )
    assert found["a"].tolist() == [2, 4]
    assert found["b"].tolist() == [1, 3, 5]


# how often the interval holds the truth and the tests cry wolf

SHAPES = {
    "gauss": (lambda g, n: g.normal(0.8, 1, n), lambda g, n: g.normal(0, 1, n), stats.norm.cdf(0.8 / np.sqrt(2))),
    "spread": (lambda g, n: g.normal(0.5, 10, n), lambda g, n: g.normal(0, 1, n), stats.norm.cdf(0.5 / np.sqrt(101))),
    "two basins": (
        lambda g, n: (g.random(n) < 0.6) * 1.0,
        lambda g, n: (g.random(n) < 0.3) * 1.0,
        0.6 * 0.7 + 0.5 * (0.18 + 0.28),
    ),
}


def a12_coverage(shape, m, n, trials):
    x, y, truth = SHAPES[shape]
    rng = np.random.default_rng(m + n)
    found = (a12_interval(x(rng, m), y(rng, n)) for _ in range(trials))
    return np.mean([low <= truth <= high for low, high in found])


def false_alarms(runs, methods, trials):
    """Share of studies of identical methods with at least one pair called different."""
    rng = np.random.default_rng(runs)
    return np.mean(
        [
            any(c.differs for c in compare({str(k): rng.gamma(2, 1, runs) for k in range(methods)}))
            for _ in range(trials)
        ]
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_a12_interval_covers(shape):
    assert 0.91 <= a12_coverage(shape, 20, 30, 400) <= 0.99  # 0.011 scatter


def test_identical_methods_are_seldom_called_different():
    assert 0.0 < false_alarms(20, 3, 300) <= 0.085  # at most 0.05 by design, 0.0126 scatter


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("m", "n"), [(10, 10), (20, 60), (100, 100)])
def test_a12_interval_covers_at_length(shape, m, n):
    assert 0.935 <= a12_coverage(shape, m, n, 4000) <= 0.985


@pytest.mark.slow
@pytest.mark.parametrize(("runs", "methods"), [(8, 2), (30, 2), (30, 5), (200, 3)])
def test_type_one_error_at_length(runs, methods):
    assert 0.03 <= false_alarms(runs, methods, 3000) <= 0.062
