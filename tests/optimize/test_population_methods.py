"""PSO and CMA-ES against known performance on shifted functions, 10-D, and CMA-ES's own formulas."""

import numpy as np
import pytest

from plantfit.optimize import Objective, minimise

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
@pytest.mark.further(2)
def test_median_of_five(method, function, settings, bound):
    results = minimise(Objective(D, function), method, runs=5, budget=20_000, seed=3, settings=settings)
    assert np.median([r.cost for r in results]) < bound
