"""Gradients of tables, added up in the carry: a scatter onto zeros that is added to an array must equal lax.scan's."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.tables import lookup, lookup2
from plantfit.native import available, native_scan

import jax
import jax.numpy as jnp

NODES = tuple(np.linspace(0.0, 4.0, 6).tolist())
NEEDED = pytest.mark.skipif(not available(), reason="llvmlite is not installed: there is no native code to test")


def bodies():
    def value(tables, x):
        k, a = tables
        return lookup(k, NODES, x) * x + lookup(k, NODES, 0.5 * x) + lookup2(a, (NODES, NODES), x, 4.0 - x)

    def summed(carry, x):
        return jax.tree.map(jnp.add, carry, jax.grad(value)((TABLES[0], TABLES[1]), x)), None

    def replaced(carry, x):
        # nothing but the scatter itself goes on: what came before is forgotten
        return jax.tree.map(lambda c, g: g + 0.0 * jnp.sum(c), carry, jax.grad(value)((TABLES[0], TABLES[1]), x)), None

    def bare(carry, x):
        return (jnp.zeros(6).at[jnp.int32(x)].add(x), carry[1]), None

    return {"summed": summed, "replaced": replaced, "bare": bare}


TABLES = jnp.asarray(np.random.default_rng(0).normal(size=6)), jnp.asarray(np.random.default_rng(1).normal(size=(6, 6)))


@NEEDED
@pytest.mark.parametrize("name", bodies())
def test_sums_over_many_steps_equal_those_of_lax(name):
    body = bodies()[name]
    xs = jnp.asarray(np.random.default_rng(2).uniform(-0.5, 4.5, (7, 50)))
    zeros = jnp.zeros(6), jnp.zeros((6, 6))
    own = jax.jit(jax.vmap(lambda x: native_scan(body, zeros, x)[0]))(xs)
    plain = jax.jit(jax.vmap(lambda x: jax.lax.scan(body, zeros, x)[0]))(xs)
    for a, b in zip(own, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    assert np.any(np.asarray(plain[0]) != 0.0)
