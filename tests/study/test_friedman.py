import numpy as np
import pytest
from scipy import stats

from plantfit.study import holm
from plantfit.study.comparing.friedman import friedman, hierarchical_interval, resampled_a12, signed_rank, smallest_p

COSTS = np.random.default_rng(3).gamma(2, 1, (12, 4)) + np.array([0.0, 0.5, 1.0, 2.0])
NAMES = ("a", "b", "c", "d")


def test_friedman_against_scipy_and_the_formulas():
    f = friedman(NAMES, COSTS)
    expected = stats.friedmanchisquare(*COSTS.T)
    assert (f.chi_square, f.p_chi_square) == pytest.approx((expected.statistic, expected.pvalue), rel=1e-12)
    n, k = COSTS.shape
    assert f.f == pytest.approx((n - 1) * f.chi_square / (n * (k - 1) - f.chi_square), rel=1e-12)
    assert f.p == pytest.approx(stats.f.sf(f.f, k - 1, (k - 1) * (n - 1)), rel=1e-12)
    assert f.mean_ranks == pytest.approx(stats.rankdata(COSTS, axis=1).mean(axis=0))
    assert f.best == "a"
    z = (np.array(f.mean_ranks[1:]) - f.mean_ranks[0]) / np.sqrt(k * (k + 1) / (6 * n))
    assert f.z[1:] == pytest.approx(z)
    assert f.p_holm[1:] == pytest.approx(holm(2 * stats.norm.sf(z)))
    assert np.isnan(f.p_holm[0])


def test_friedman_with_ties_against_scipy():
    rounded = np.round(COSTS)
    assert friedman(NAMES, rounded).chi_square == pytest.approx(
        stats.friedmanchisquare(*rounded.T).statistic, rel=1e-12
    )


def test_units_of_a_problem_and_the_order_of_problems_do_not_matter():
    scaled = COSTS * np.geomspace(1e-6, 1e6, len(COSTS))[:, None] + 3
    assert friedman(NAMES, scaled[::-1]).p == pytest.approx(friedman(NAMES, COSTS).p, rel=1e-12)


def test_ties_only_perfect_order_and_failures():
    assert friedman(("a", "b", "c"), np.ones((5, 3))).p == 1.0
    perfect = friedman(("a", "b", "c"), np.tile([3.0, 1.0, 2.0], (6, 1)))
    assert (perfect.best, perfect.f, perfect.p) == ("b", np.inf, 0.0)
    assert friedman(("a", "b", "c"), np.array([[1.0, 2.0, np.nan]] * 4)).mean_ranks == (1.0, 2.0, 3.0)


def test_signed_rank_compares_ratios():
    first, second = COSTS[:, 0] + 0.1, COSTS[:, 2] + 0.1
    assert signed_rank(first, second) == pytest.approx(stats.wilcoxon(np.log(first / second))[1])
    units = np.geomspace(1e-9, 1e9, len(first))
    assert signed_rank(first * units, second * units) == pytest.approx(signed_rank(first, second))
    assert signed_rank(first, first) == 1.0
    assert signed_rank(-first, -second) == pytest.approx(stats.wilcoxon(second - first)[1])


@pytest.mark.parametrize("n", [3, 5, 6])
def test_smallest_p_is_that_of_a_clean_sweep(n):
    assert stats.wilcoxon(np.arange(1.0, n + 1))[1] == pytest.approx(smallest_p(n))


def test_type_one_error_of_friedman_on_identical_methods():
    rng = np.random.default_rng(0)
    p = np.array([friedman(("a", "b", "c"), rng.random((10, 3))).p for _ in range(600)])
    assert 0.02 <= np.mean(p < 0.05) <= 0.08  # 0.009 scatter; ranks are discrete


@pytest.mark.thorough
def test_resampled_a12_agrees_with_scipys_bootstrap():
    rng = np.random.default_rng(2)
    x, y = rng.normal(0.5, 1, 25), rng.normal(0, 1, 30)
    found = resampled_a12(x, y, rng=rng, resamples=4000)
    draws = [stats.mannwhitneyu(rng.choice(x, 25), rng.choice(y, 30)).statistic / 750 for _ in range(2000)]
    assert found.mean() == pytest.approx(np.mean(draws), abs=0.005)
    assert found.std() == pytest.approx(np.std(draws), rel=0.08)


def test_hierarchical_interval_covers_the_mean_over_problems():
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(200):
        effects = rng.normal(0.6, 0.1, 20)  # problems differ
        runs = effects[:, None] + rng.normal(0, 0.05, (20, 1))  # measured with error
        low, high = hierarchical_interval(runs + rng.normal(0, 0.05, (20, 400)), rng=rng)
        inside += low <= 0.6 <= high
    assert inside >= 178  # 190 by design, 3 scatter; both spreads counted makes it a little wide
