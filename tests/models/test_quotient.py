"""Division and its derivatives, against those of lax."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.quotient import quotient

# isort: split
import jax
import jax.numpy as jnp

PAIRS = [(2.0, 0.3), (-1.5, -4.0), (0.0, 7.0), (3e-160, 2e-160), (1e8, 1e-9)]


def plain(a, b):
    return a / b


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_values_and_slopes(a, b):
    assert quotient(jnp.asarray(a), b) == a / b
    found = jax.grad(quotient, argnums=(0, 1))(a, b)
    np.testing.assert_allclose(found, [1 / b, -(a / b) / b], rtol=1e-15)


@pytest.mark.parametrize(
    "order", [(jax.jacfwd, jax.jacrev), (jax.jacrev, jax.jacfwd), (jax.jacfwd, jax.jacfwd), (jax.jacrev, jax.jacrev)]
)
@pytest.mark.further(1)
def test_nested_derivatives(order):
    outer, inner = order
    bent = [outer(inner(f, argnums=(0, 1)), argnums=(0, 1))(1.7, -0.6) for f in (quotient, plain)]
    np.testing.assert_allclose(bent[0], bent[1], rtol=1e-14)
    third = [float(jax.grad(jax.grad(jax.grad(f, 1), 0), 1)(1.7, -0.6)) for f in (quotient, plain)]
    assert third[0] == pytest.approx(third[1], rel=1e-14)


USES = [lambda q, a, b: q(a, b), lambda q, a, b: q(a, 3), lambda q, a, b: q(2, b), lambda q, a, b: q(b, a)]


@pytest.mark.parametrize("use", USES)
@pytest.mark.thorough
def test_shapes_that_broadcast(use):
    a, b = jnp.asarray(np.random.default_rng(0).normal(size=(3, 1))), jnp.asarray([0.5, -2.0, 3.0, 8.0])
    ours, theirs = (
        jax.jacrev(lambda a, b, q=q: jnp.sin(use(q, a, b)), argnums=(0, 1))(a, b) for q in (quotient, plain)
    )
    np.testing.assert_array_equal(use(quotient, a, b), use(plain, a, b))
    for s, t in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(s, t, rtol=1e-13, atol=1e-300)
    forwards = jax.vmap(lambda a: jax.jvp(lambda a: use(quotient, a, b), (a,), (jnp.ones_like(a),))[1])(a)
    plainly = jax.vmap(lambda a: jax.jvp(lambda a: use(plain, a, b), (a,), (jnp.ones_like(a),))[1])(a)
    np.testing.assert_allclose(forwards, plainly, rtol=1e-14)


def test_numbers_without_arrays_stay_as_they_are():
    assert quotient(3, 4) == 0.75
    assert isinstance(quotient(3, 4), float)
