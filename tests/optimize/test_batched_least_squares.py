"""Least squares from many starts side by side: the same answers as one after another, with what it charges."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize

import plantfit.runtime  # noqa: F401
from plantfit.optimize import minimise
from plantfit.optimize.batched_least_squares import Lanes
from plantfit.testing.objectives import from_residuals

import jax
import jax.numpy as jnp

TOGETHER = {"side_by_side": 8}


def batched(residuals, dimension):
    """An objective that also evaluates several points at once; `calls` lists how many it was given."""
    objective = from_residuals(residuals, dimension)
    both = jax.jit(jax.vmap(lambda x: (residuals(x), jax.jacfwd(residuals)(x))))
    calls = []

    def batch(x):
        calls.append(len(x))
        return both(x)

    return dataclasses.replace(objective, batch_residuals_and_jacobian=batch), calls


def decays(z):
    t = jnp.linspace(0.0, 3.0, 60)
    return 2 * z[0] * jnp.exp(-(10 ** (2 * z[1] - 1)) * t) - 0.9 * jnp.exp(-0.7 * t) + 0.01 * jnp.sin(9 * t)


def test_same_answer_as_scipy():
    objective, calls = batched(decays, 2)
    [together] = minimise(objective, "least_squares", budget=4000, seed=1, settings=TOGETHER)
    [alone] = minimise(objective, "least_squares", budget=4000, seed=1, settings={"side_by_side": 1})
    assert together.status == alone.status == "converged"
    np.testing.assert_allclose(together.x, alone.x, atol=1e-7)
    assert together.cost == pytest.approx(alone.cost, rel=1e-12)
    assert set(calls) == {8}


def test_every_start_finds_the_bounds_of_a_linear_problem():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(60, 20)), 4 * rng.normal(size=60)
    reference = optimize.lsq_linear(a, b, bounds=(0, 1), method="bvls", tol=1e-14)
    on_bound = reference.active_mask != 0
    assert np.sum(on_bound) >= 5
    objective, _ = batched(lambda z: a @ z - b, 20)
    [r] = minimise(objective, "least_squares", budget=6000, seed=1, settings={"side_by_side": 16, "agree": 1_000_000})
    assert r.extra["starts"] > 50
    assert r.extra["basin_hits"] == r.extra["starts"]
    assert np.array_equal(r.x[on_bound], reference.x[on_bound])
    np.testing.assert_allclose(r.x, reference.x, atol=1e-7)


def test_charges_are_those_of_the_points():
    objective, _ = batched(decays, 2)
    budget = 33 * objective.jacobian_charge + 1
    [r] = minimise(objective, "least_squares", budget=int(budget), seed=1, settings={**TOGETHER, "agree": 1_000_000})
    assert r.status == "budget"
    assert r.evaluations == 33 * objective.jacobian_charge


def test_starts_that_cannot_be_simulated_are_skipped():
    objective, _ = batched(lambda z: jnp.where(z[0] < 0.5, jnp.nan, 1.0) * jnp.stack([z[0] - 0.7, z[1] - 0.2]), 2)
    [r] = minimise(objective, "least_squares", budget=3000, seed=1, settings={**TOGETHER, "agree": 10})
    assert r.cost < 1e-24
    assert r.extra["skipped_starts"] > 0
    assert r.extra["basin_hits"] >= 10


def test_first_step_solves_a_linear_problem_up_to_its_damping():
    rng = np.random.default_rng(1)
    a, x = rng.normal(size=(5, 30, 4)), rng.uniform(0.4, 0.6, size=(5, 4))
    optimum = rng.uniform(0.3, 0.7, size=(5, 4))
    r = np.einsum("bij,bj->bi", a, x - optimum)
    matrix = np.einsum("bij,bik->bjk", a, a)
    lanes = Lanes.begin(x, np.ones(5, bool), (np.sum(r**2, axis=1), np.einsum("bij,bi->bj", a, r), matrix))
    lanes.damping[:] = 1e-12
    step, promised = lanes.propose()
    np.testing.assert_allclose(x + step, optimum, atol=1e-9)
    np.testing.assert_allclose(promised, lanes.cost, rtol=1e-9)


def test_a_step_ends_on_the_bounds_and_solves_for_the_rest():
    rng = np.random.default_rng(2)
    a, target = rng.normal(size=(12, 3)), np.array([1.4, 0.5, -0.3])
    x = np.full(3, 0.5)
    r = a @ (x - target)
    lanes = Lanes.begin(x[None], np.ones(1, bool), (np.array([r @ r]), (a.T @ r)[None], (a.T @ a)[None]))
    lanes.damping[:] = 1e-12
    step, promised = lanes.propose()
    free = optimize.lsq_linear(a, a @ target, bounds=(0, 1), method="bvls").x
    np.testing.assert_allclose(x + step[0], free, atol=1e-8)
    left = a @ (x + step[0] - target)
    assert promised[0] == pytest.approx(r @ r - left @ left, rel=1e-9)


def test_robust_losses_go_one_after_another():
    objective, calls = batched(decays, 2)
    [r] = minimise(objective, "least_squares", budget=2000, seed=1, settings={**TOGETHER, "loss": "huber", "f_scale": 0.01})
    assert not calls
    assert np.isfinite(r.cost)
