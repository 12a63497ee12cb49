"""What a method leaves as it is in its state is not copied run by run, and changes no bit."""

import numpy as np
import pytest

from plantfit.optimize import Objective, minimise
from plantfit.optimize.loop import generations

import jax
import jax.numpy as jnp
from jax import lax


def bowl(x):
    return jnp.sum((x - 0.3) ** 2 * jnp.arange(1.0, 7.0), axis=-1)


def plain(function, given, state):
    return lax.map(lambda both: function(*both), (given, state))


@pytest.mark.parametrize("method", ["cmaes", "dd_cmaes", "shade", "pso"])
@pytest.mark.parametrize("budget", [400, 30_000])  # apart, and in blocks
@pytest.mark.thorough
def test_the_bits_are_those_of_a_plain_map(monkeypatch, method, budget):
    def searched():
        jax.clear_caches()
        for kept in (generations._compiled, generations._begin):
            kept.cache_clear()
        return minimise(Objective(6, lambda x: bowl(x)), method, budget=budget, runs=2, seed=4, stagnation=4000)

    ours = searched()
    monkeypatch.setattr(generations, "_mapped_beside", plain)
    for a, b in zip(ours, searched(), strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        assert a.evaluations == b.evaluations


def test_only_what_changes_is_mapped():
    given, state = jnp.arange(3.0), {"stays": jnp.ones((3, 40, 40)), "moves": jnp.zeros((3, 2))}

    def function(a, s):
        return 2.0 * a, {**s, "moves": s["moves"] + a}

    found, after = generations._mapped_beside(function, given, state)
    np.testing.assert_array_equal(found, 2.0 * given)
    np.testing.assert_array_equal(after["moves"], np.repeat(np.arange(3.0)[:, None], 2, axis=1))
    assert after["stays"] is state["stays"]
