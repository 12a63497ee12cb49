"""Elementary functions against numpy's long double, in units in the last place.

XLA runs with subnormal numbers flushed to zero, so they are left out.
"""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan

# isort: split
import jax
import jax.numpy as jnp

N = 40_000


def spread(low, high, seed=0):
    return np.random.default_rng(seed).uniform(low, high, N)


def decades(low, high):
    draw = np.random.default_rng(5)
    return 10 ** draw.uniform(low, high, N) * draw.choice([-1.0, 1.0], N)


CASES = {
    "exp": (jnp.exp, np.exp, [spread(-708, 709), spread(-1, 1), decades(-20, 0)]),
    "expm1": (jnp.expm1, np.expm1, [spread(-50, 700), spread(-1, 1), decades(-300, 0)]),
    "log": (jnp.log, np.log, [np.exp(spread(-708, 709)), spread(0.5, 2.0), 10.0 ** spread(-307, -300)]),
    "log1p": (jnp.log1p, np.log1p, [np.exp(spread(-30, 700)), spread(-0.9999, 1), decades(-300, -0.1)]),
    "tanh": (jnp.tanh, np.tanh, [spread(-25, 25), spread(-1, 1), decades(-300, 0)]),
    "sin": (jnp.sin, np.sin, [spread(-10, 10), spread(-1e6, 1e6), decades(-300, 0), decades(6, 15)]),
    "cos": (jnp.cos, np.cos, [spread(-10, 10), spread(-1e6, 1e6), decades(6, 15)]),
}


@pytest.mark.parametrize("name", CASES)
def test_within_two_ulp(name):
    function, exact, samples = CASES[name]
    x = np.concatenate(samples)
    run = jax.jit(jax.vmap(lambda v: native_scan(lambda c, _: (function(c), None), v, None, length=1)[0]))
    found = np.asarray(run(x))
    true = exact(x.astype(np.longdouble))
    assert np.finfo(np.longdouble).nmant > 60, "this platform's long double is no wider than float64"
    with np.errstate(over="ignore"):
        size = np.spacing(np.abs(true.astype(float)))
    error = np.abs((found.astype(np.longdouble) - true) / size).astype(float)
    assert np.max(error) <= 2.0, f"{np.max(error)} ulp at {x[np.argmax(error)]!r}"


@pytest.mark.parametrize("name", CASES)
def test_special_values(name):
    function, exact, _ = CASES[name]
    x = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, -2.0, 710.0, -800.0, 1e300, 2.0**20, -(2.0**20), 1.0, -1.0])
    found = np.asarray(jax.jit(lambda v: native_scan(lambda c, a: (c, function(a)), 0.0, v, keep=True)[1])(x))
    with np.errstate(all="ignore"):
        true = exact(x)
    np.testing.assert_allclose(found, true, rtol=4e-16, atol=0)
    zero = true == 0
    np.testing.assert_array_equal(np.signbit(found[zero]), np.signbit(true[zero]))
