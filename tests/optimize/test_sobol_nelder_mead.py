"""Sobol search and Nelder-Mead: against scipy, with warm starts, up to many dimensions."""

import contextlib
import dataclasses

import numpy as np
import pytest
from scipy import optimize
from scipy.stats import qmc

from plantfit.errors import SearchError
from plantfit.optimize import Objective, minimise
from plantfit.optimize.algorithms.nelder_mead import NelderMead
from plantfit.optimize.algorithms.sobol_search import SobolSearch
from plantfit.optimize.loop.counter import BudgetSpent, Counter
from plantfit.testing.objectives import bowl

import jax
import jax.numpy as jnp


def seen(objective, method, budget):
    """Every point (n, d) that a host method evaluates."""
    points = []

    class Watching(Counter):
        def costs(self, x):
            points.append(np.atleast_2d(x).copy())
            return super().costs(x)

    with contextlib.suppress(BudgetSpent):
        method.run(jax.random.key(3), objective, budget, Watching(objective, budget))
    return np.concatenate(points)


def test_sobol_points_are_even_and_begin_with_the_warm_starts():
    warm = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    points = seen(dataclasses.replace(bowl(3), start=warm), SobolSearch(batch=50), 514)
    np.testing.assert_array_equal(points[:2], warm)
    assert points.shape == (514, 3)
    assert len(np.unique(points, axis=0)) == 514
    # every sixteenth of every axis holds its share exactly, which random points do not
    for column in points[2:].T:
        assert set(np.bincount((column * 16).astype(int), minlength=16)) == {32}
    assert qmc.discrepancy(points[2:]) < 0.1 * qmc.discrepancy(np.random.default_rng(0).random((512, 3)))


@pytest.mark.filterwarnings("error")
def test_sobol_batches_do_not_matter():
    a, b = (minimise(bowl(3), "sobol", budget=700, seed=2, settings={"batch": n})[0] for n in (7, 700))
    assert np.array_equal(a.x, b.x)
    assert a.evaluations == b.evaluations == 700


def test_sobol_says_how_far_it_goes():
    d = qmc.Sobol.MAXDIM
    wide = Objective(d, lambda x: jnp.sum(x, axis=1))
    assert minimise(wide, "sobol", budget=2)[0].evaluations == 2
    with pytest.raises(SearchError, match="choose 'random'"):
        minimise(dataclasses.replace(wide, dimension=d + 1), "sobol", budget=2)


def rosenbrock(dimension):
    def costs(z):
        x = 4 * z - 1
        return jnp.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)

    return Objective(dimension, costs)


def test_nelder_mead_descends_like_scipy_from_the_same_simplex():
    objective, start = rosenbrock(4), np.array([0.1, 0.3, 0.2, 0.6])
    points = seen(dataclasses.replace(objective, start=start[None]), NelderMead(), 300)
    assert np.all((points >= 0) & (points <= 1))
    np.testing.assert_array_equal(points[0], start)
    twin = []

    def cost(z):
        twin.append(z.copy())
        return float(objective.costs(z[None])[0])

    simplex = np.vstack([start, start + 0.1 * np.eye(4)])
    options = {"adaptive": True, "initial_simplex": simplex, "maxfev": 250, "xatol": 1e-10, "fatol": 0.0}
    optimize.minimize(cost, start, method="Nelder-Mead", bounds=[(0, 1)] * 4, options=options)
    np.testing.assert_allclose(points[:200], np.array(twin)[:200], rtol=1e-6)


def test_nelder_mead_finds_a_curved_valley_and_goes_on_elsewhere():
    [r] = minimise(rosenbrock(4), "nelder_mead", budget=6000, seed=1)
    assert r.cost < 1e-12
    np.testing.assert_allclose(r.x, 0.5, atol=1e-5)
    assert r.extra["starts"] > 1


def test_nelder_mead_takes_a_warm_start_on_the_edge():
    corner = Objective(
        3, lambda z: jnp.sum((z - jnp.array([1.2, 0.4, -0.1])) ** 2, axis=1), start=np.array([[1.0, 1.0, 0.0]])
    )
    [r] = minimise(corner, "nelder_mead", budget=1500, seed=1)
    np.testing.assert_allclose(r.x, [1.0, 0.4, 0.0], atol=1e-6)


def test_nelder_mead_skips_starts_that_cannot_be_simulated():
    half = Objective(2, lambda z: jnp.where(z[:, 0] < 0.7, jnp.nan, jnp.sum((z - 0.8) ** 2, axis=1)))
    [r] = minimise(half, "nelder_mead", budget=3000, seed=1)
    assert r.cost < 1e-15
    assert r.extra["skipped_starts"] > 0
    np.testing.assert_allclose(r.x, 0.8, atol=1e-6)
