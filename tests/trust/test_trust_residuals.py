"""Residual tests: how often they cry wolf, and whether they see what is there."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit.trust import autocorrelation, cross_correlation, whiteness
from plantfit.trust.validate.residual_tests import independent, white_part


def ar1(rng, n, rho) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -rho], rng.normal(size=n + 200)))[200:]


@pytest.mark.parametrize("n", [200, 1000])
def test_whiteness_rejects_white_noise_as_often_as_it_says(n):
    rng = np.random.default_rng(n)
    rejected = np.mean([whiteness(rng.normal(size=n))[1] < 0.05 for _ in range(600)])
    assert 0.025 < rejected < 0.08


def test_whiteness_sees_a_weak_correlation():
    rng = np.random.default_rng(0)
    assert np.mean([whiteness(ar1(rng, 2000, 0.2))[1] < 0.01 for _ in range(50)]) > 0.9


@pytest.mark.parametrize("rho_input", [0.0, 0.95])
@pytest.mark.parametrize("rho_residual", [0.0, 0.7])
def test_cross_correlation_keeps_its_level_with_slow_inputs(rho_input, rho_residual):
    rng = np.random.default_rng(7)
    outside, wrong, trials = [], 0, 200
    for _ in range(trials):
        found = cross_correlation(ar1(rng, 1500, rho_residual), ar1(rng, 1500, rho_input))
        outside.append(np.mean(np.abs(found.values) > found.bound))
        wrong += not independent(found)
    assert 0.02 < np.mean(outside) < 0.08
    assert wrong / trials < 0.06


def test_cross_correlation_finds_an_unexplained_input_at_its_lag():
    rng = np.random.default_rng(1)
    u = rng.normal(size=1000)
    e = 0.3 * np.r_[np.zeros(6), u[:-6]] + rng.normal(size=1000)
    found = cross_correlation(e, u)
    assert not independent(found)
    assert found.lags[np.argmax(np.abs(found.values))] == 6
    assert found.values.max() == pytest.approx(0.3 / np.sqrt(1.09), abs=0.06)


def test_correlations_equal_their_definition():
    rng = np.random.default_rng(2)
    e, u = rng.normal(size=50), rng.normal(size=50)
    c = e - e.mean()
    np.testing.assert_allclose(autocorrelation(e, 5), [c[: 50 - k] @ c[k:] / (c @ c) for k in range(6)], atol=1e-12)
    v, found = u - u.mean(), cross_correlation(e, u, 3)
    for lag, value in zip(found.lags, found.values, strict=True):
        pairs = c[lag:] @ v[: 50 - lag] if lag >= 0 else c[:lag] @ v[-lag:]
        assert value == pytest.approx(pairs / np.sqrt((c @ c) * (v @ v)), abs=1e-12)


def test_tests_do_not_depend_on_scale_or_offset():
    rng = np.random.default_rng(3)
    e, u = ar1(rng, 300, 0.5), rng.normal(size=300)
    np.testing.assert_allclose(autocorrelation(3.0 * e + 5.0, 10), autocorrelation(e, 10), atol=1e-12)
    np.testing.assert_allclose(cross_correlation(-2.0 * e + 1.0, 4.0 * u - 3.0).values, -cross_correlation(e, u).values, atol=1e-12)
    assert whiteness(1e-6 * e)[1] == pytest.approx(whiteness(e)[1])


def test_a_constant_residual_is_no_error():
    assert autocorrelation(np.ones(30), 3).tolist() == [1.0, 0.0, 0.0, 0.0]
    assert cross_correlation(np.ones(30), np.arange(30.0)).values.tolist() == [0.0] * 13


@pytest.mark.parametrize("noise", [1e-3, 2.0])
def test_white_part_is_the_noise_whatever_slow_error_lies_under_it(noise):
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 20.0, 4000)
    assert white_part(10.0 * noise * np.sin(t) + noise * rng.normal(size=t.size)) == pytest.approx(noise, rel=0.06)


def test_white_part_leaves_out_missing_samples():
    rng = np.random.default_rng(5)
    e = rng.normal(size=4000)
    e[::50] = np.nan
    assert white_part(e) == pytest.approx(1.0, rel=0.06)
    assert np.isnan(white_part(np.array([1.0, 2.0])))
