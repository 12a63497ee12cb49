"""Least squares, L-BFGS-B and auto: certified answers, bounds, outliers, failures."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize

from plantfit.optimize import Objective, minimise
from plantfit.testing.objectives import from_residuals

import jax.numpy as jnp

# NIST StRD, Misra1a: y = b1 (1 - exp(-b2 x))
MISRA_X = np.array([77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0])
MISRA_Y = np.array([10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78])
MISRA_B, MISRA_RSS = np.array([2.3894212918e02, 5.5015643181e-04]), 1.2455138894e-01
LOW, HIGH = np.array([50.0, 1e-5]), np.array([1000.0, 1e-2])


def misra(z):
    b = LOW + z * (HIGH - LOW)
    return b[0] * (1 - jnp.exp(-b[1] * MISRA_X)) - MISRA_Y


def wave(z):
    t = jnp.linspace(0.0, 1.0, 40)
    return z[1] * jnp.sin(40 * z[0] * t) - 0.5 * jnp.sin(40 * 0.62 * t) + 0.01 * jnp.cos(77 * t)


@pytest.mark.parametrize(("method", "digits"), [("least_squares", 8), ("auto", 8), ("lbfgsb", 5)])
def test_misra1a(method, digits):
    [r] = minimise(from_residuals(misra, 2), method, budget=5000, seed=1)
    b = LOW + r.x * (HIGH - LOW)
    np.testing.assert_allclose(b, MISRA_B, rtol=10.0**-digits)
    assert r.cost * len(MISRA_X) == pytest.approx(MISRA_RSS, rel=1e-9)


@pytest.mark.parametrize("method", ["least_squares", "auto", "lbfgsb"])
@pytest.mark.further(1)
def test_best_of_many_minima(method):
    results = minimise(from_residuals(wave, 2), method, runs=5, budget=3000, seed=1)
    assert all(abs(r.x[0] - 0.62) < 1e-3 for r in results)
    assert max(r.cost for r in results) == pytest.approx(min(r.cost for r in results), rel=1e-6)


@pytest.mark.parametrize("method", ["least_squares", "auto", "lbfgsb"])
def test_optimum_exactly_on_bounds(method):
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(20, 5)), 4 * rng.normal(size=20)
    reference = optimize.lsq_linear(a, b, bounds=(0, 1), method="bvls")
    assert np.sum(reference.active_mask != 0) >= 2
    [r] = minimise(from_residuals(lambda z: a @ z - b, 5), method, budget=4000, seed=1)
    np.testing.assert_allclose(r.x, reference.x, atol=1e-7)
    on_bound = reference.active_mask != 0
    assert np.array_equal(r.x[on_bound], reference.x[on_bound])


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy"])
def test_robust_loss_shrugs_off_outliers(loss):
    t = np.linspace(0, 1, 50)
    y = 0.3 + 0.4 * t
    y[::10] += 5.0

    def line(z):
        return z[0] + z[1] * t - y

    objective = from_residuals(line, 2)
    [robust] = minimise(objective, "least_squares", budget=2000, seed=1, settings={"loss": loss, "f_scale": 0.01})
    [plain] = minimise(objective, "least_squares", budget=2000, seed=1)
    assert np.max(np.abs(robust.x - [0.3, 0.4])) < 0.02
    assert np.max(np.abs(plain.x - [0.3, 0.4])) > 0.2
    # the cost stays the mean square, which the plain fit minimises
    assert robust.cost == pytest.approx(float(np.mean(np.asarray(line(robust.x)) ** 2)))
    assert robust.cost > plain.cost
    reference = optimize.least_squares(
        lambda z: np.asarray(line(z)), [0.5, 0.5], bounds=(0, 1), loss=loss, f_scale=0.01, xtol=1e-12
    )
    np.testing.assert_allclose(robust.x, reference.x, atol=1e-5)


@pytest.mark.thorough
def test_auto_says_why():
    full = from_residuals(wave, 2)
    assert "residuals" in minimise(full, "auto", budget=500)[0].extra["reason"]
    assert (
        "L-BFGS-B"
        in minimise(dataclasses.replace(full, residuals_and_jacobian=None), "auto", budget=500)[0].extra["reason"]
    )
    [r] = minimise(Objective(2, full.costs), "auto", budget=2000)
    assert "CMA-ES" in r.extra["reason"]
    assert r.method == "auto"


def test_auto_stops_early_when_the_answer_repeats():
    [r] = minimise(from_residuals(misra, 2), "auto", budget=100_000, seed=1)
    assert r.status == "converged"
    assert r.evaluations < 5000
    assert r.extra["basin_hits"] >= 3
    assert r.extra["starts"] == len(r.extra["local_costs"]) >= 5


@pytest.mark.parametrize("method", ["least_squares", "lbfgsb", "auto"])
def test_scale_of_the_cost_does_not_matter(method):
    answers = [
        minimise(from_residuals(lambda z, s=s: s * misra(z), 2), method, budget=2000, seed=1)[0].x
        for s in (1e-6, 1.0, 1e6)
    ]
    np.testing.assert_allclose(answers[0], answers[1], rtol=1e-4)
    np.testing.assert_allclose(answers[2], answers[1], rtol=1e-4)
