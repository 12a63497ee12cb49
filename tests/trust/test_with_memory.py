"""Variances of estimates that few samples decide: correlated errors of neighbours add up, as the residuals of the
whole record show."""

import numpy as np
import pytest
from scipy.signal import lfilter

import plantfit as pf
from plantfit.trust.finish.descent import descent
from plantfit.trust.intervals.covariance import with_memory
from plantfit.trust.intervals.linearised import linearise


def ar1(rng, n, r, size=1.0):
    return size * np.sqrt(1 - r**2) * lfilter([1.0], [1.0, -r], rng.standard_normal(n + 300))[300:]


def test_it_is_the_sum_over_all_pairs():
    rng = np.random.default_rng(0)
    influences, residuals = rng.standard_normal((400, 3)), ar1(rng, 400, 0.6)
    r = np.sum(residuals[1:] * residuals[:-1]) / np.sum(residuals**2)
    r = r + (1 + 3 * r + 2 * (1 + r)) / 400  # of residuals of two fitted parameters
    lags = np.abs(np.subtract.outer(np.arange(400), np.arange(400)))
    np.testing.assert_allclose(with_memory(influences, residuals, 2), influences.T @ r**lags @ influences, rtol=1e-9)


@pytest.mark.parametrize(
    "residuals", [np.random.default_rng(1).standard_normal(400), -ar1(np.random.default_rng(2), 8, 0.9)]
)
def test_correlations_that_chance_explains_count_as_none(residuals):
    influences = np.random.default_rng(3).standard_normal((len(residuals), 2))
    np.testing.assert_array_equal(with_memory(influences, residuals, 2), influences.T @ influences)


@pytest.mark.parametrize("memory", [0.0, 0.5])
@pytest.mark.thorough
def test_ranges_of_a_free_start_hold(memory):
    """Of a start that a tenth of the samples decide 84 % held it under such noise."""
    model = pf.models.make("first_order", dead_time=False, initial="free")
    t = 0.1 * np.arange(150)
    u = np.random.default_rng(9).uniform(0.0, 1.0, 15).repeat(10)
    bounds = {"K": (0.1, 20.0), "tau": (0.1, 20.0), "c": (-5.0, 5.0), "y0": (-5.0, 5.0)}
    truth = {"K": 2.0, "tau": 1.0, "c": 0.5, "y0": 1.0}
    problem = pf.Problem(
        model, pf.Recording(t, {"u": pf.Signal(u), "y": pf.Signal(np.zeros(150))}, "run"), bounds, substeps=2
    )
    clean, held = problem.predict(problem.space.vector(truth))["y"], []
    for seed in range(120):
        y = clean + ar1(np.random.default_rng(seed), 150, memory, 0.05)
        noisy = problem.with_recordings({"run": pf.Recording(t, {"u": pf.Signal(u), "y": pf.Signal(y)}, "run")})
        z = descent(noisy, problem.space.cube(problem.space.vector(truth)) + 0.01).z
        linear = linearise(noisy, z).linear
        assert linear is not None
        held.append(np.abs(linear.values - problem.space.vector(truth)) <= linear.quantile * linear.standard_error)
    shares = dict(zip(problem.space.names, np.mean(held, axis=0), strict=True))
    assert all(share >= 0.88 for share in shares.values()), shares  # fewer in one of a thousand times
