"""Residual tests: how often they cry wolf, and whether they see what is there."""

import numpy as np
import pytest
from scipy.signal import lfilter

import plantfit as pf
from plantfit.models.text.equations import equations
from plantfit.problem import Experiment, Problem
from plantfit.problem.measure.sample_noise import white_part
from plantfit.recording import Recording, Signal
from plantfit.trust import autocorrelation, cross_correlation, whiteness
from plantfit.trust.validate.residuals.residual_tests import independent, measured_rows


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
    np.testing.assert_allclose(
        cross_correlation(-2.0 * e + 1.0, 4.0 * u - 3.0).values, -cross_correlation(e, u).values, atol=1e-12
    )
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


def test_a_signal_with_times_of_its_own_is_tested_from_one_measurement_to_the_next():
    rng = np.random.default_rng(3)
    own = ar1(rng, 1500, 0.6)
    between = np.full(3000, np.nan)
    between[::2] = own
    np.testing.assert_array_equal(between[measured_rows(between)], own)
    with_gaps = own.copy()
    with_gaps[rng.uniform(size=1500) < 0.2] = np.nan  # gaps stay gaps
    assert len(measured_rows(with_gaps)) == 1500


def noisy_line(shared, seed=4):
    """A constant seen at every second sample, differences of neighbouring edges as its errors, as a disc's slots
    make them."""
    rng = np.random.default_rng(seed)
    n = 1200
    u, y = np.tile([1.0, 3.0], n // 2), np.full(n, np.nan)
    edges = rng.normal(size=n // 2 + 1)
    y[::2] = 5.0 + np.diff(edges)
    signals = {"u": Signal(u), "y": Signal(y), "slot": Signal(np.where(np.isfinite(y), np.arange(n) % 400, np.nan))}
    record = Recording(np.arange(n) * 0.01, signals, "disc")
    model = equations("y = a + 0*u", inputs=["u"], outputs=["y"], parameters={"a": {"bounds": (0.0, 20.0)}})
    return pf.fit(Problem(model, Experiment(record, shared_errors={"y": "slot"} if shared else {})), "auto", seed=1)


def test_noise_of_a_right_model_is_no_problem_and_its_pattern_is_named():
    answer = noisy_line(shared=True)
    (row,) = answer.findings["residual_tests"]
    assert row["autocorrelation"][1] == pytest.approx(-0.5, abs=0.08)  # of differences of white noise
    assert row["lags_s"][1] == pytest.approx(0.02)
    said = {v["sentence"]: v["level"] for v in answer.findings["verdict"]}
    fit = next(s for s in said if s.startswith("The model follows y"))
    assert said[fit] == "info"
    assert "what is left is its noise from sample to sample" in fit
    pattern = next(s for s in said if "not white" in s)
    assert said[pattern] == "info"
    assert "come back with slot" in pattern
    assert "bad" not in said.values()
    unaware = noisy_line(shared=False)
    assert next(v["level"] for v in unaware.findings["verdict"] if "not white" in v["sentence"]) == "warning"
