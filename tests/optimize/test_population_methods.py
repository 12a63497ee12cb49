"""PSO and CMA-ES against known performance on shifted functions, 10-D, and CMA-ES's own formulas."""

import numpy as np
import pytest

from plantfit.optimize import Objective, minimise
from plantfit.optimize.cmaes import strategy

import jax.numpy as jnp

D = 10
OPTIMUM = np.linspace(0.2, 0.85, D)
Q = np.linalg.qr(np.random.default_rng(0).normal(size=(D, D)))[0]
CONDITION = 10.0 ** (6 * np.arange(D) / (D - 1))


def sphere(x):
    return jnp.sum((10 * (x - OPTIMUM)) ** 2, axis=1)


def ellipsoid(x):
    return jnp.sum(CONDITION * ((10 * (x - OPTIMUM)) @ Q) ** 2, axis=1)


def rosenbrock(x):
    z = 10 * (x - OPTIMUM) + 1
    return jnp.sum(100 * (z[:, 1:] - z[:, :-1] ** 2) ** 2 + (1 - z[:, :-1]) ** 2, axis=1)


@pytest.mark.parametrize(
    ("method", "function", "settings", "bound"),
    [
        ("pso", sphere, {"population": 40}, 1e-15),
        ("pso", sphere, {"topology": "ring", "bounds": "reflect"}, 1e-5),
        ("pso", rosenbrock, {}, 20.0),
        ("cmaes", sphere, {}, 1e-15),
        ("cmaes", ellipsoid, {}, 1e-9),
        ("cmaes", rosenbrock, {}, 1e-9),
    ],
)
def test_median_of_five(method, function, settings, bound):
    results = minimise(Objective(D, function), method, runs=5, budget=20_000, seed=3, settings=settings)
    assert np.median([r.cost for r in results]) < bound


@pytest.mark.parametrize("n", [1, 2, 10, 310])
def test_strategy_parameters(n):
    rows = 4 + int(3 * np.log(n))
    s = strategy(rows, n)
    assert np.isclose(s.w[s.w > 0].sum(), 1.0)
    assert np.isclose(s.mu_eff, 1 / np.sum(s.w[s.w > 0] ** 2))
    assert s.w[s.w < 0].sum() < 0
    assert 0 < s.c_1 + s.c_mu <= 1
    # the update keeps the covariance positive definite even if all negative weights fall on one axis
    assert 1 - s.c_1 - s.c_mu * s.w.sum() + n * s.c_mu * s.w[s.w < 0].sum() >= -1e-12


def test_cmaes_restarts_from_a_flat_start_and_ends():
    [r] = minimise(Objective(2, lambda x: 0.0 * x[:, 0]), "cmaes", budget=50_000, settings={"restarts": 2})
    assert r.status == "converged"
    assert r.evaluations < 2000
