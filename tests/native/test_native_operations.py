"""Every operation against lax.scan on the same numbers, special ones included."""

from functools import cache

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan

# isort: split
import jax
import jax.numpy as jnp
from jax import lax

SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    1.5,
    2.5,
    -2.5,
    np.inf,
    -np.inf,
    np.nan,
    1e-300,
    1e300,
    -1e300,
    0.3,
    0.999,
    1e5,
    7.25,
    -3.75,
]


def both(body, carry, xs, **settings):
    """(native, lax) results of a scan that keeps its rows."""
    native = jax.jit(lambda c, x: native_scan(body, c, x, keep=True, **settings))(carry, xs)
    plain = jax.jit(lambda c, x: lax.scan(body, c, x, **settings))(carry, xs)
    return native, plain


def assert_close(native, plain, rtol=1e-14, atol=0.0):
    a, b = jax.tree.leaves(native), jax.tree.leaves(plain)
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        assert x.shape == y.shape
        assert x.dtype == y.dtype
        np.testing.assert_allclose(np.asarray(x), np.asarray(y), rtol=rtol, atol=atol)


def rowwise(function):
    return lambda c, x: (c, function(*x))


UNARY = {
    "neg": lambda a: -a,
    "sign": jnp.sign,
    "floor": jnp.floor,
    "ceil": jnp.ceil,
    "round": jnp.round,
    "round_away": lax.round,
    "abs": jnp.abs,
    "square": jnp.square,
    "sqrt": jnp.sqrt,
    "rsqrt": lax.rsqrt,
    "cbrt": jnp.cbrt,
    "exp": jnp.exp,
    "exp2": jnp.exp2,
    "expm1": jnp.expm1,
    "log": jnp.log,
    "log1p": jnp.log1p,
    "log2": jnp.log2,
    "sin": jnp.sin,
    "cos": jnp.cos,
    "tan": jnp.tan,
    "tanh": jnp.tanh,
    "sinh": jnp.sinh,
    "cosh": jnp.cosh,
    "asin": jnp.arcsin,
    "acos": jnp.arccos,
    "atan": jnp.arctan,
    "asinh": jnp.arcsinh,
    "acosh": jnp.arccosh,
    "atanh": jnp.arctanh,
    "logistic": jax.nn.sigmoid,
    "erf": jax.scipy.special.erf,
    "cube": lambda a: a**3,
    "inverse_square": lambda a: a**-2,
    "seventh": lambda a: a**7,
    "is_finite": jnp.isfinite,
    "isnan": jnp.isnan,
    "clip": lambda a: jnp.clip(a, -1.25, 2),
    "to_i32": lambda a: a.astype(jnp.int32),
    "to_i64": lambda a: jnp.clip(a, -1e12, 1e12).astype(jnp.int64),
    "to_bool": lambda a: a.astype(bool),
    "relu": jax.nn.relu,
    "softplus": jax.nn.softplus,
    "hypot": lambda a: jnp.hypot(a, 2.0),
    "reciprocal": lambda a: 1 / a,
    "signbit": lambda a: jnp.copysign(1.0, a),
    "polynomial": lambda a: jnp.polyval(jnp.array([0.25, 0.5, 2.0]), a),
    "slope of atanh": jax.grad(jnp.arctanh),
}

ROUGH_IN_XLA = {"cbrt": 2e-14, "atanh": 4e-14, "asinh": 2e-14}  # ours is the C library's

BINARY = {
    "add": jnp.add,
    "sub": jnp.subtract,
    "mul": jnp.multiply,
    "div": jnp.divide,
    "max": jnp.maximum,
    "min": jnp.minimum,
    "pow": jnp.power,
    "atan2": jnp.arctan2,
    "rem": lax.rem,
    "mod": jnp.mod,
    "eq": jnp.equal,
    "ne": jnp.not_equal,
    "lt": jnp.less,
    "le": jnp.less_equal,
    "gt": jnp.greater,
    "ge": jnp.greater_equal,
    "where": lambda a, b: jnp.where(a < b, a, b),
    "nextafter": jnp.nextafter,
    "logic": lambda a, b: (a > 0) & (b > 0) | ~(a < b) ^ (b == 1),
    "copysign": jnp.copysign,
    "heaviside": lambda a, b: jnp.heaviside(a, b),
}


def all_of(functions):
    """One body that applies every function: one compilation for all tests of a kind."""
    return lambda c, x: (c, {name: f(*x) for name, f in functions.items()})


@cache
def unary():
    """Numbers, native and lax results by name."""
    x = np.concatenate([SPECIAL, np.random.default_rng(0).normal(size=40) * 2])
    return x, *(r[1] for r in both(all_of(UNARY), 0.0, (x,)))


@pytest.mark.parametrize("name", UNARY)
def test_unary(name):
    _, native, plain = unary()
    assert_close(native[name], plain[name], rtol=ROUGH_IN_XLA.get(name, 4e-15))


@cache
def binary():
    a, b = (v.ravel() for v in np.meshgrid(SPECIAL, SPECIAL))
    return tuple(r[1] for r in both(all_of(BINARY), 0.0, (a, b)))


@pytest.mark.parametrize("name", BINARY)
def test_binary(name):
    native, plain = binary()
    assert_close(native[name], plain[name], rtol=4e-15)


def test_unary_lanes_equal_one_lane():
    """The vector code and the code for one number give the same bits."""
    x, one, _ = unary()
    many = jax.jit(jax.vmap(lambda v: native_scan(all_of(UNARY), 0.0, (v[None],), keep=True)[1]))(x)
    for name in UNARY:
        np.testing.assert_array_equal(np.asarray(one[name]), np.asarray(many[name])[:, 0], err_msg=name)


INTEGER = {
    "add": jnp.add,
    "sub": jnp.subtract,
    "mul": jnp.multiply,
    "floor_divide": jnp.floor_divide,
    "div": lax.div,
    "rem": lax.rem,
    "mod": jnp.mod,
    "max": jnp.maximum,
    "min": jnp.minimum,
    "and": jnp.bitwise_and,
    "or": jnp.bitwise_or,
    "xor": jnp.bitwise_xor,
    "lt": jnp.less,
    "ge": jnp.greater_equal,
    "eq": jnp.equal,
    "neg": lambda a, b: -a,
    "abs": lambda a, b: jnp.abs(a),
    "sign": lambda a, b: jnp.sign(a),
    "not": lambda a, b: ~a,
    "power": lambda a, b: a**3,
    "float": lambda a, b: a.astype(float) * 0.25,
    "shift_left": lambda a, b: a << (b % 7),
    "shift_right": lambda a, b: a >> (b % 7),
    "to_i64": lambda a, b: a.astype(jnp.int64),
    "to_i32": lambda a, b: a.astype(jnp.int32),
    "to_u32": lambda a, b: a.astype(jnp.uint32),
    "select": lambda a, b: jnp.where(a > b, a, b),
}


@cache
def integer(dtype):
    low = 0 if dtype == np.uint32 else np.iinfo(dtype).min
    values = np.array([0, 1, 2, 3, 7, 100, np.iinfo(dtype).max, low], dtype=dtype)
    if dtype != np.uint32:
        values = np.concatenate([values, -values[1:5]])
    a, b = (v.ravel() for v in np.meshgrid(values, values))
    return tuple(r[1] for r in both(all_of(INTEGER), 0.0, (a, b)))


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint32])
@pytest.mark.parametrize("name", INTEGER)
def test_integer(name, dtype):
    native, plain = integer(dtype)
    assert native[name].dtype == plain[name].dtype
    np.testing.assert_array_equal(np.asarray(native[name]), np.asarray(plain[name]))


def test_bool_arithmetic():
    a, b = np.array([True, True, False, False]), np.array([True, False, True, False])
    body = rowwise(
        lambda a, b: (a & b, a | b, a ^ b, ~a, jnp.maximum(a, b), jnp.where(a, 1.5, 2.5), a.astype(int) + b, a < b)
    )
    assert_close(*both(body, 0.0, (a, b)))


def test_a_rounding_to_the_bits_of_float64_changes_nothing():
    """As jax marks what `jax.checkpoint` keeps."""
    native, plain = both(lambda c, x: (c + lax.reduce_precision(x, 11, 52),) * 2, 0.0, jnp.array([0.1, 1e-300, 3.0]))
    assert_close(native, plain, rtol=0.0)


def test_select_among_many():
    body = rowwise(lambda i, x: lax.select_n(i, x, 2 * x, 3 * x))
    assert_close(*both(body, 0.0, (np.array([0, 1, 2, 1], np.int32), np.arange(4.0))))


def test_inner_calls_and_custom_rules():
    @jax.custom_jvp
    def cube(x):
        return x**3

    cube.defjvp(lambda p, t: (cube(*p), 3 * p[0] ** 2 * t[0]))

    @jax.custom_vjp
    def double(x):
        return 2 * x

    double.defvjp(lambda x: (double(x), None), lambda _, g: (2 * g,))

    def body(c, x):
        inner = jax.jit(lambda a: a + cube(a))(c)
        c = double(0.1 * inner) + jax.checkpoint(jnp.sin)(x) + jax.grad(cube)(x) * 0.01
        return lax.stop_gradient(c), jax.jvp(cube, (c,), (1.0,))

    assert_close(*both(body, 0.2, np.linspace(0, 1, 20)), rtol=1e-12)


def test_reverse_carry_pytree_and_closed_over_values():
    table, shift = jnp.arange(6.0) ** 2, jnp.asarray(0.25)

    def body(c, x):
        new = {"a": c["a"] * 0.5 + x["u"] + shift, "n": c["n"] + 1}
        return new, (new["a"] * table[2], c["n"])

    xs = {"u": np.linspace(-1, 1, 15)}
    native, plain = both(body, {"a": 1.0, "n": 3}, xs, reverse=True)
    assert_close(native, plain)


def test_length_without_rows():
    body = lambda c, _: (c * 1.01 + 0.1, c)  # noqa: E731
    assert_close(*both(body, 1.0, None, length=17))


def test_no_steps():
    carry, ys = native_scan(lambda c, x: (c + x, c), 1.5, np.zeros(0), keep=True)
    assert float(carry) == 1.5
    assert ys.shape == (0,)


def test_rows_are_dropped_unless_kept():
    carry, ys = native_scan(lambda c, x: (c + x, c), 0.0, np.arange(4.0))
    assert (float(carry), ys) == (6.0, None)
