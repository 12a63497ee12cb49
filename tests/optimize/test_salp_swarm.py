"""Salp swarm: its equations in units, its schedule, and where its variants depend on the box."""

import numpy as np
import pytest
from scipy import stats
from test_genetic_algorithms import noise

from plantfit.errors import SearchError
from plantfit.optimize import Objective, minimise
from plantfit.optimize.algorithms.salp_swarm import SalpSwarm, follow
from plantfit.optimize.contract import Facts

import jax
import jax.numpy as jnp

N, D, BUDGET = 10, 3, 400


def boxed(costs, d, low):
    """The cost over the box [low, low + 10]^d."""
    return Objective(d, costs, lower=np.full(d, float(low)), upper=np.full(d, low + 10.0))


@pytest.mark.parametrize(("n", "leaders"), [(2, 1), (3, 1), (50, 25), (300, 1)])
def test_followers_move_one_after_another(n, leaders):
    x = np.random.default_rng(n).uniform(size=(n, 2))
    chain = x.copy()
    for i in range(leaders, n):
        chain[i] = (chain[i] + chain[i - 1]) / 2
    np.testing.assert_allclose(follow(jnp.asarray(x), leaders), chain, rtol=0, atol=5e-16)


@pytest.mark.parametrize(
    ("variant", "share", "leaders"),
    [("published", 0.5, 5), ("paper", 0.5, 1), ("published", 0.0, 1), ("published", 1.0, N)],
)
@pytest.mark.parametrize("low", [-5.0, 0.0, 2.5])
@pytest.mark.further(3)
def test_generation_in_units(variant, share, leaders, low):
    """One generation against the equations in raw coordinates, with the same random numbers."""
    method = SalpSwarm(population=N, variant=variant, leaders=share)
    lb, ub = np.full(D, low), low + np.array([10.0, 1.0, 4.0])
    state = method.init(jax.random.key(0), Facts(D, BUDGET, lb, ub))
    x, state = method.ask(jax.random.key(1), state)
    f = jnp.sum((x - 0.4) ** 2, axis=1)
    state, _ = method.tell(state, x, f)
    salps, food = lb + np.asarray(x) * (ub - lb), lb + np.asarray(x)[int(jnp.argmin(f))] * (ub - lb)
    key = jax.random.key(2)
    moved, _ = jax.jit(method.ask)(key, state)
    l = 1 if variant == "paper" else 2  # noqa: E741
    c1 = 2 * np.exp(-((4 * l / (BUDGET // N)) ** 2))
    c2, c3 = np.asarray(jax.random.uniform(key, (2, leaders, D)))
    for i in range(N):
        if i < leaders:
            sign = np.where((c3[i] >= 0) if variant == "paper" else (c3[i] < 0.5), 1.0, -1.0)
            salps[i] = food + sign * c1 * ((ub - lb) * c2[i] + lb)
        else:
            salps[i] = (salps[i] + salps[i - 1]) / 2
    np.testing.assert_allclose(lb + np.asarray(moved) * (ub - lb), np.clip(salps, lb, ub), atol=1e-12)


def test_food_is_never_a_failure():
    method = SalpSwarm(population=N, variant="shift_invariant")
    state = method.init(jax.random.key(0), Facts(D, BUDGET))
    x, state = method.ask(jax.random.key(1), state)
    lost, _ = method.tell(state, x, jnp.full(N, jnp.inf))
    assert lost.food_f == np.inf
    assert np.all(np.isfinite(method.ask(jax.random.key(2), lost)[0]))
    found, _ = method.tell(lost, x, jnp.full(N, jnp.inf).at[4].set(2.0))
    np.testing.assert_array_equal(found.food, x[4])


def test_needs_the_box_only_where_it_reads_it():
    def sphere(x):
        return jnp.sum((x - 0.65) ** 2, axis=1)

    with pytest.raises(SearchError, match="bounds in units"):
        minimise(Objective(2, sphere), "salp_swarm", budget=200)
    [r] = minimise(Objective(2, sphere), "salp_swarm", budget=1000, settings={"variant": "shift_invariant"})
    assert r.cost < 1e-6
    assert SalpSwarm().needs.schedule_bound
    assert SalpSwarm(variant="shift_invariant").needs.schedule_bound


def _sphere(variant, low, d=10):
    def sphere(x):
        return jnp.sum((10 * (x - 0.65)) ** 2, axis=1)

    results = minimise(
        boxed(sphere, d, low), "salp_swarm", runs=7, budget=20_000, seed=1, settings={"variant": variant}
    )
    return np.array([r.cost for r in results])


def test_shift_invariant_has_the_same_bits_in_every_box():
    near, far = _sphere("shift_invariant", -5), _sphere("shift_invariant", 100)
    np.testing.assert_array_equal(near, far)
    assert np.median(near) < 1e-9


@pytest.mark.thorough
def test_published_gets_worse_far_from_zero_and_paper_is_worse_still():
    near, far, paper = _sphere("published", -5), _sphere("published", 100), _sphere("paper", -5)
    assert np.median(near) < 1e-10
    assert np.median(far) > 30 * np.median(near)
    assert np.median(paper) > 1e-4


def _noise(variant, low):
    runs, d = 80, 25
    settings = {"variant": variant, "population": 30}
    results = minimise(boxed(noise, d, low), "salp_swarm", runs=runs, budget=3000, seed=2, settings=settings)
    x = np.concatenate([r.x for r in results])
    return np.mean((x == 0) | (x == 1)), stats.kstest(x, "uniform").statistic


@pytest.mark.thorough
def test_structural_bias_on_noise():
    """Published: towards the bounds, growing with their distance from zero; shift invariant: as mild everywhere."""
    near, far, ours = _noise("published", -5), _noise("published", 100), _noise("shift_invariant", 100)
    assert 0.03 < ours[1] < 0.12
    assert 0.05 < ours[0] < 0.2
    assert 0.02 < near[0] < 0.15
    assert far[0] > 0.25
    assert far[1] > 0.15
