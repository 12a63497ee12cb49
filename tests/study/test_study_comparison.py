import numpy as np
import pytest
from scipy import stats

from plantfit.study import a12, compare, holm

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
