"""Standard errors: against ordinary least squares, and by how often their intervals hold the truth."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as student

from plantfit.problem.measure.long_run import bandwidth, first_correlation, long_run, prewhitened_long_run
from plantfit.trust import covariance, flat_directions
from plantfit.trust.intervals.covariance import Block, own_student, sandwich
from plantfit.trust.intervals.ranges import effective_samples


def regression(seed, n=400, rho=0.0, noise=1.0):
    """Jacobian (n, 3) with a slow column, and AR(1) noise of unit variance times `noise`."""
    rng = np.random.default_rng(seed)
    slow = lfilter([1.0], [1.0, -0.8], rng.normal(size=n))
    matrix = 20.0 * np.c_[np.ones(n), rng.normal(size=n), slow]
    e = noise * np.sqrt(1.0 - rho**2) * lfilter([1.0], [1.0, -rho], rng.normal(size=n + 100))[100:]
    return matrix, e


def fit(matrix, y):
    estimate = np.linalg.lstsq(matrix, y)[0]
    residuals = matrix @ estimate - y
    block = Block(slice(0, len(y)), np.arange(len(y)))
    return estimate, covariance(matrix, residuals, [block], np.ones(matrix.shape[1], bool))


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9])
def test_intervals_hold_the_truth_as_often_as_they_say(rho):
    truth, held, seeds = np.array([0.5, 0.4, 0.6]), np.zeros(3), 300
    for seed in range(seeds):
        matrix, e = regression(seed, n=800, rho=rho)
        estimate, cov = fit(matrix, matrix @ truth + e)
        held += np.abs(estimate - truth) <= 1.96 * np.sqrt(np.diag(cov))
    assert np.all(held / seeds >= 0.90), held / seeds
    assert np.all(held / seeds <= 0.98), held / seeds


def test_ignoring_the_correlation_would_fail_that_test():
    truth, held, seeds = np.array([0.5, 0.4, 0.6]), np.zeros(3), 300
    for seed in range(seeds):
        matrix, e = regression(seed, n=800, rho=0.6)
        y = matrix @ truth + e
        estimate = np.linalg.lstsq(matrix, y)[0]
        r = y - matrix @ estimate
        classical = np.linalg.inv(matrix.T @ matrix) * (r @ r) / (len(r) - 3)
        held += np.abs(estimate - truth) <= 1.96 * np.sqrt(np.diag(classical))
    assert held[0] / seeds < 0.85


def test_white_residuals_give_the_classical_standard_errors():
    matrix, e = regression(1, n=4000)
    _, cov = fit(matrix, matrix @ np.array([0.1, 0.2, 0.3]) + e)
    classical = np.linalg.inv(matrix.T @ matrix) * (e @ e) / (len(e) - 3)
    np.testing.assert_allclose(np.sqrt(np.diag(cov)), np.sqrt(np.diag(classical)), rtol=0.08)


def test_scaling_residuals_and_jacobian_together_changes_nothing():
    matrix, e = regression(2, rho=0.5)
    block, free = [Block(slice(0, len(e)), np.arange(len(e)))], np.ones(3, bool)
    np.testing.assert_allclose(
        covariance(matrix, e, block, free), covariance(7.0 * matrix, 7.0 * e, block, free), rtol=1e-9
    )


def test_permuting_parameters_permutes_the_covariance():
    matrix, e = regression(2, rho=0.5)
    block, order = [Block(slice(0, len(e)), np.arange(len(e)))], [2, 0, 1]
    there, free = covariance(matrix, e, block, np.ones(3, bool)), np.ones(3, bool)
    np.testing.assert_allclose(covariance(matrix[:, order], e, block, free), there[np.ix_(order, order)], rtol=1e-9)


def test_a_column_without_information_keeps_the_spread_of_the_box():
    matrix, e = regression(3)
    cov = covariance(np.c_[matrix, np.zeros(len(e))], e, [Block(slice(0, len(e)), np.arange(len(e)))], np.ones(4, bool))
    assert np.sqrt(cov[3, 3]) == pytest.approx(1.0 / np.sqrt(12.0), rel=1e-9)


@pytest.mark.parametrize("together", [2, 9])
def test_values_known_only_in_sum_keep_the_spread_of_the_box_each(together):
    # y depends on the sum of several values: each may be anywhere in the box while the others make up for it
    matrix, e = regression(3)
    cov = covariance(np.c_[matrix, np.repeat(20.0 * np.sin(np.arange(len(e)))[:, None], together, axis=1)], e,
                     [Block(slice(0, len(e)), np.arange(len(e)))], np.ones(3 + together, bool))  # fmt: skip
    assert np.all(np.sqrt(np.diag(cov)[3:]) > 0.2)
    assert np.all(np.diag(cov) <= (1.0 + 1e-12) / 12.0)
    total = np.r_[np.zeros(3), np.ones(together)]
    assert np.sqrt(total @ cov @ total) < 0.1  # the sum itself is known


def test_coordinates_on_a_bound_have_no_variance():
    matrix, e = regression(3)
    block = [Block(slice(0, len(e)), np.arange(len(e)))]
    cov = covariance(matrix, e, block, np.array([True, False, True]))
    assert np.all(cov[1] == 0.0)
    assert np.all(cov[:, 1] == 0.0)
    np.testing.assert_allclose(
        cov[np.ix_([0, 2], [0, 2])], covariance(matrix[:, [0, 2]], e, block, np.ones(2, bool)), rtol=1e-9
    )


@pytest.mark.parametrize("lags", [0, 1, 7])
def test_long_run_sum_equals_its_definition(lags):
    series = np.random.default_rng(0).normal(size=(40, 2))
    expected = np.zeros((2, 2))
    for i, a in enumerate(series):
        for j, b in enumerate(series):
            if abs(i - j) <= lags:
                expected += (1.0 - abs(i - j) / (lags + 1.0)) * np.outer(a, b)
    np.testing.assert_allclose(long_run(series, lags), expected, atol=1e-10)


@pytest.mark.parametrize("rho", [0.3, 0.8])
def test_long_run_variance_of_an_ar1_is_found_also_with_gaps(rho):
    # the sum of n samples of e' = rho e + w has variance n / (1 - rho)^2
    n = 100_000
    e = np.asarray(lfilter([1.0], [1.0, -rho], np.random.default_rng(6).normal(size=n)))[:, None]
    assert prewhitened_long_run(e, np.arange(n))[0, 0] / n == pytest.approx(1.0 / (1.0 - rho) ** 2, rel=0.05)
    # of samples kept by chance with probability q: q^2 of that, and q (1 - q) of the plain variance
    q, kept = 0.9, np.flatnonzero(np.random.default_rng(7).uniform(size=n) < 0.9)
    expected = q**2 / (1.0 - rho) ** 2 + q * (1.0 - q) / (1.0 - rho**2)
    assert prewhitened_long_run(e[kept], kept)[0, 0] / n == pytest.approx(expected, rel=0.15)  # gaps blur the AR(1)


def test_short_blocks_are_taken_as_white():
    scores = np.ones((5, 1))
    assert prewhitened_long_run(scores, np.arange(5)) == pytest.approx(5.0)


def test_bandwidth_grows_with_correlation():
    lags = [bandwidth(regression(5, n=2000, rho=r)[1][:, None]) for r in (0.0, 0.5, 0.9)]
    assert lags[0] < lags[1] < lags[2]
    assert bandwidth(np.zeros((50, 2))) == 0
    assert first_correlation(np.zeros((50, 2))).tolist() == [0.0, 0.0]


def test_the_flat_direction_of_a_product_is_named():
    # y = R K u: only R K counts
    u, values = np.linspace(1.0, 2.0, 200), np.array([4.0, 0.5, 3.0])
    jacobian = np.c_[values[1] * u, values[0] * u, np.sin(9.0 * u)] / 0.01
    directions = flat_directions(jacobian.T @ jacobian, values, np.array([1e3, 1e3, 1e3]), ("R", "K", "c"))
    assert len(directions) == 1
    weights = directions[0].weights
    assert set(weights) == {"R", "K"}
    assert weights["R"] == pytest.approx(-weights["K"], rel=1e-3)
    assert directions[0].relative_sd > 1.0
    assert {"R*K", "K*R"} & {directions[0].constant}
    assert "R" in directions[0].sentence
    assert "shrinks" in directions[0].sentence


def test_the_flat_direction_of_a_quotient_is_named():
    u, values = np.linspace(1.0, 2.0, 200), np.array([4.0, 0.5])
    jacobian = np.c_[u / values[1], -values[0] / values[1] ** 2 * u] / 0.01
    directions = flat_directions(jacobian.T @ jacobian, values, np.array([1e3, 1e3]), ("R", "K"))
    assert {"R/K", "K/R"} & {directions[0].constant}
    assert "can grow together" in directions[0].sentence


def test_determined_parameters_have_no_flat_direction():
    matrix, _ = regression(0)
    assert flat_directions(matrix.T @ matrix, np.ones(3), np.full(3, 10.0), ("a", "b", "c")) == []


@pytest.mark.parametrize(("n", "rho"), [(800, 0.97), (100, 0.5)])
def test_slow_residuals_and_short_records_have_intervals_that_hold(n, rho):
    """Four regressors, two of them slow; without the correction of the correlation's bias 0.885 of the means are
    held at 0.97."""
    held, seeds = np.zeros(4), 200
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        slow, slower = (lfilter([1.0], [1.0, -memory], rng.normal(size=n)) for memory in (0.8, 0.99))
        matrix = np.c_[np.ones(n), rng.normal(size=n), slow, slower]
        e = np.sqrt(1.0 - rho**2) * np.asarray(lfilter([1.0], [1.0, -rho], rng.normal(size=n + 500)))[500:]
        estimate = np.linalg.lstsq(matrix, e)[0]
        residuals, block = matrix @ estimate - e, Block(slice(0, n), np.arange(n))
        bread = np.linalg.inv(matrix.T @ matrix) * (residuals @ residuals) / (n - 4)
        spread = sandwich(
            matrix, residuals, [block], bread, np.zeros((4, 4)), float(residuals @ residuals) / (n - 4), n - 4, True
        )
        samples = effective_samples(residuals, [block], 4)[0]
        held += np.abs(estimate) <= student.ppf(0.975, max(1.0, samples - 4)) * np.sqrt(np.diag(spread))
    assert np.all(held / seeds >= 0.90), held / seeds
    assert np.all(held / seeds <= 0.99), held / seeds


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize(("few", "given"), [(3, True), (4, True), (4, False), (8, False), (25, False)])
@pytest.mark.further(6)
def test_an_output_of_few_samples_has_intervals_that_hold(few, given, robust):
    """Two parameters seen by y at 150 samples, two more by w at few: its scale is given, or the rms of its
    residuals."""
    held, seeds, m = np.zeros(4), 400, 150 + few
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        matrix = rng.normal(size=(m, 4))
        matrix[:150, 2:] = 0.0
        e = rng.normal(size=m) * np.where(np.arange(m) < 150, 1.0, 7.0)
        scale, w, left, estimate = np.array([1.0, 7.0]), np.ones(m), e, np.zeros(4)
        for _ in range(1 if given else 30):
            w = np.repeat(1.0 / scale, (150, few))
            estimate = np.linalg.lstsq(matrix * w[:, None], e * w)[0]
            left = matrix @ estimate - e
            scale = scale if given else np.array([np.sqrt(np.mean(left[:150] ** 2)), np.sqrt(np.mean(left[150:] ** 2))])
        j, residuals = matrix * w[:, None], left * w
        variance = float(residuals @ residuals) / (m - 4)
        blocks = [Block(slice(0, 150), np.arange(150), "y", given), Block(slice(150, m), np.arange(few), "w", given)]
        bread = np.linalg.inv(j.T @ j) * variance
        spread = sandwich(j, residuals, blocks, bread, np.zeros((4, 4)), variance, m - 4, robust)
        longer = own_student(j, residuals, blocks, bread, variance, m - 4.0)
        held += np.abs(estimate) <= student.ppf(0.975, m - 4) * longer * np.sqrt(np.diag(spread))
    assert np.all(held / seeds >= 0.91), held / seeds
    assert np.all(held / seeds <= 0.99), held / seeds


def test_where_samples_are_worth_too_little_intervals_are_not_sound():
    n = 300
    e = np.cumsum(np.random.default_rng(5).normal(size=n))
    block = [Block(slice(0, n), np.arange(n))]
    assert effective_samples(e - e.mean(), block, 2)[0] < 10
    assert effective_samples(np.random.default_rng(5).normal(size=n), block, 2)[0] > 250


def uneven(seed, n=600):
    """Jacobian (n, 2) and white noise that is a tenth as large in the half of the samples that alone tell the second
    value."""
    rng = np.random.default_rng(seed)
    quiet = np.arange(n) % 2 == 0
    matrix = np.c_[np.where(quiet, 0.0, 1.0), np.where(quiet, 1.0, 0.0)] * rng.normal(size=(n, 2))
    return matrix, rng.normal(size=n) * np.where(quiet, 0.1, 1.0)


def test_samples_with_less_noise_make_intervals_that_are_not_too_wide():
    held, ratio = np.zeros(2), []
    for seed in range(300):
        matrix, e = uneven(seed)
        estimate, cov = fit(20.0 * matrix, e)
        held += np.abs(estimate) <= 1.96 * np.sqrt(np.diag(cov))
        ratio.append(np.sqrt(np.diag(cov)) / (np.array([1.0, 0.1]) / 20.0 / np.linalg.norm(matrix, axis=0)))
    # that of residuals of one size is 7 times as wide
    assert np.all(np.mean(ratio, axis=0) < 1.15), np.mean(ratio, axis=0)
    assert np.all(held / 300 > 0.92), held / 300


def test_few_samples_that_follow_the_noise_do_not_make_intervals_narrow():
    held, of = 0, 400
    for seed in range(of):
        rng = np.random.default_rng(seed)
        matrix = 20.0 * np.c_[np.ones(300), np.r_[np.ones(4), np.zeros(296)]]
        estimate, cov = fit(matrix, rng.normal(size=300))
        held += abs(estimate[1]) <= 1.96 * np.sqrt(cov[1, 1])
    assert held / of > 0.92, held / of
