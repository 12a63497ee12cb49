import numpy as np
import pytest
from scipy import stats

from plantfit.errors import Status
from plantfit.study import (
    RunRecord,
    bootstrap_interval,
    costs_by_method,
    evaluations_to_target,
    expected_running_time,
    success_rate,
    summarise,
    t_interval,
    wilson_interval,
)

VALUES = np.random.default_rng(5).gamma(2.0, size=23)


def test_summary_against_scipy():
    s = summarise(VALUES, seed=3)
    assert (s.n, s.failed, s.minimum, s.maximum) == (23, 0, VALUES.min(), VALUES.max())
    described = stats.describe(VALUES)
    assert s.mean == pytest.approx(described.mean, rel=1e-14)
    assert s.std**2 == pytest.approx(described.variance, rel=1e-14)
    assert s.sem == pytest.approx(stats.sem(VALUES), rel=1e-14)
    assert s.median == np.sort(VALUES)[11]
    expected = stats.ttest_1samp(VALUES, 0.0).confidence_interval(0.95)
    assert s.t_interval == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert s.bootstrap_interval[0] < s.mean < s.bootstrap_interval[1]


def test_mean_and_sem_of_one_to_five():
    s = summarise([5, 1, 4, 2, 3])
    assert (s.mean, s.median, s.std, s.sem) == pytest.approx((3, 3, np.sqrt(2.5), np.sqrt(0.5)))
    assert s.t_interval[1] - s.mean == pytest.approx(2.7764451 * np.sqrt(0.5), rel=1e-7)  # tables: t(0.975, 4)


def test_summary_leaves_failures_out_and_counts_them():
    with_failures = summarise([*VALUES, np.inf, np.nan])
    assert with_failures.failed == 2
    assert (with_failures.n, with_failures.mean, with_failures.t_interval) == (23, summarise(VALUES).mean, summarise(VALUES).t_interval)
    nothing = summarise([np.inf])
    assert (nothing.n, nothing.failed) == (0, 1)
    assert np.isnan(nothing.mean)


def test_costs_by_method():
    runs = [
        RunRecord(m, 0, 1, np.zeros(1), c, {}, 1.0, 0.0, Status.budget, 0, np.zeros(1), np.zeros(1), {})
        for m, c in (("b", 2.0), ("a", 1.0), ("b", 3.0))
    ]
    found = costs_by_method(runs)
    assert list(found) == ["b", "a"]
    assert found["b"].tolist() == [2.0, 3.0]


def test_one_run_has_no_spread_and_equal_runs_have_none():
    one = summarise([2.0])
    assert one.mean == 2.0
    assert np.isnan([one.std, one.sem, *one.t_interval, *one.bootstrap_interval]).all()
    assert summarise([2.0, 2.0, 2.0]).bootstrap_interval == (2.0, 2.0)


@pytest.mark.parametrize(("shift", "scale"), [(7.0, 1.0), (0.0, 3.0), (-2.0, 0.5)])
def test_shift_and_scale(shift, scale):
    a, b = summarise(VALUES), summarise(shift + scale * VALUES)
    for name in ("minimum", "maximum", "median", "mean"):
        assert getattr(b, name) == pytest.approx(shift + scale * getattr(a, name), rel=1e-12)
    assert (b.std, b.sem) == pytest.approx((scale * a.std, scale * a.sem), rel=1e-12)
    for name in ("t_interval", "bootstrap_interval"):
        assert getattr(b, name) == pytest.approx([shift + scale * v for v in getattr(a, name)], rel=1e-9)


def test_order_of_runs_does_not_matter():
    shuffled = np.random.default_rng(1).permutation(VALUES)
    assert summarise(shuffled).mean == pytest.approx(summarise(VALUES).mean, rel=1e-14)
    assert t_interval(shuffled) == pytest.approx(t_interval(VALUES), rel=1e-12)


def test_bootstrap_is_seeded_and_covers():
    assert bootstrap_interval(VALUES, seed=1) == bootstrap_interval(VALUES, seed=1)
    assert bootstrap_interval(VALUES, seed=1) != bootstrap_interval(VALUES, seed=2)
    rng = np.random.default_rng(0)
    inside = 0
    for k in range(100):
        low, high = bootstrap_interval(rng.normal(size=30), seed=k, resamples=499)
        inside += low <= 0.0 <= high
    assert 86 <= inside <= 100  # 95 expected; 86 is four standard deviations away


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (10, 10), (1, 1), (57, 100)])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_wilson_against_scipy(k, n, level):
    expected = stats.binomtest(k, n).proportion_ci(level, method="wilson")
    assert wilson_interval(k, n, level) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_success_rate_counts_the_target_itself_and_misses_nan():
    rate, interval = success_rate([1.0, 2.0, 3.0, np.nan], 2.0)
    assert rate == 0.5
    assert interval == wilson_interval(2, 4)


def test_evaluations_to_target():
    assert evaluations_to_target([10, 20, 40], [3.0, 1.0, 0.5], 1.0) == 20.0
    assert evaluations_to_target([10, 20, 40], [3.0, 1.0, 0.5], 0.1) == np.inf


def test_expected_running_time_of_a_geometric_try():
    # two of five runs hit after 100 and 300, three spent 1000: (100 + 300 + 3000) / 2
    assert expected_running_time([1000] * 5, [100, np.inf, 300, np.inf, np.inf]) == 1700.0
    assert expected_running_time([1000], [np.inf]) == np.inf
