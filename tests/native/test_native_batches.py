"""Batches of every kind, the same bits in every size, threads, and what is refused."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import PlantfitError
from plantfit.native import NativeUnsupported, available, native_scan, supported

# isort: split
import jax
import jax.numpy as jnp
from jax import lax

RNG = np.random.default_rng(4)
K = 12


def loop(scan, p, table, x0, xs, keep=True):
    def body(c, x):
        x0, count = c
        x1 = 0.9 * x0 + p * x["u"] + table[(count % 3)] * jnp.tanh(x0)
        return (jnp.where(x["on"], x1, x0), count + 1), x1

    return scan(body, (x0, 0), xs, keep=True) if scan is native_scan else scan(body, (x0, 0), xs)


def data(*sizes):
    p, table, x0 = (RNG.normal(size=(*sizes, *s)) for s in ((), (3,), ()))
    xs = {"u": RNG.normal(size=(*sizes, K)), "on": RNG.uniform(size=(*sizes, K)) > 0.2}
    return p, table, x0, xs


AXES = [
    (0, 0, 0, 0),
    (0, None, None, None),
    (None, 0, None, None),
    (None, None, 0, None),
    (None, None, None, 0),
    (0, 0, None, None),
]


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("size", [1, 33, 70])
@pytest.mark.further(5)
def test_one_axis(axes, size):
    full = data(size)
    args = [a if axis == 0 else jax.tree.map(lambda v: v[0], a) for a, axis in zip(full, axes, strict=True)]
    ways = [jax.vmap(lambda *a, scan=scan: loop(scan, *a), in_axes=axes) for scan in (native_scan, lax.scan)]
    results = jax.jit(lambda *a: [way(*a) for way in ways])(*args)
    for a, b in zip(*map(jax.tree.leaves, results), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


PAIRS = [
    (AXES[i], AXES[j]) for i, j in [(0, 0), (0, 1), (1, 4), (4, 1), (5, 4), (4, 5), (2, 3), (3, 4), (4, 4), (1, 1)]
]


@pytest.mark.parametrize(("inner", "outer"), PAIRS)
@pytest.mark.further(2)
def test_two_axes(inner, outer):
    sizes = 5, 18
    args = []
    for leaf, i, o in zip(data(*sizes), inner, outer, strict=True):
        cut = (slice(None) if o == 0 else 0, slice(None) if i == 0 else 0)
        args.append(jax.tree.map(lambda v, cut=cut: v[cut], leaf))
    ways = [
        jax.vmap(jax.vmap(lambda *a, scan=scan: loop(scan, *a), in_axes=inner), in_axes=outer)
        for scan in (native_scan, lax.scan)
    ]
    results = jax.jit(lambda *a: [way(*a) for way in ways])(*args)
    for a, b in zip(*map(jax.tree.leaves, results), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


def test_three_axes_and_rows_along_the_last():
    p, table, x0, xs = data(2, 3, 4)
    xs = {"u": np.moveaxis(xs["u"][0, :, 0], -1, 0), "on": np.moveaxis(xs["on"][0, :, 0], -1, 0)}  # (K, 3)
    results = []
    for scan in (native_scan, lax.scan):
        f = jax.vmap(lambda *a, scan=scan: loop(scan, *a), in_axes=(0, 0, 0, None))
        f = jax.vmap(f, in_axes=(0, 0, 0, 1), out_axes=-1)
        results.append(jax.jit(jax.vmap(f, in_axes=(0, 0, 0, None)))(p, table, x0, xs))
    for a, b in zip(*map(jax.tree.leaves, results), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("rows", [None, 0])
@pytest.mark.thorough
def test_same_bits_in_every_batch_and_order(rows):
    p, table, x0, xs = data(70)
    if rows is None:
        xs = jax.tree.map(lambda v: v[0], xs)
    run = jax.jit(jax.vmap(lambda *a: loop(native_scan, *a)[1], in_axes=(0, 0, 0, rows)))
    pick = lambda order: (p[order], table[order], x0[order], jax.tree.map(lambda v: v[order], xs) if rows == 0 else xs)  # noqa: E731
    whole = np.asarray(run(p, table, x0, xs))
    for size in (1, 2, 8, 9, 16, 17, 31, 50):
        np.testing.assert_array_equal(np.asarray(run(*pick(np.arange(size)))), whole[:size])
    order = RNG.permutation(70)
    np.testing.assert_array_equal(np.asarray(run(*pick(order))), whole[order])
    one = jax.jit(lambda *a: loop(native_scan, *a)[1])
    xs0 = jax.tree.map(lambda v: v[0], xs) if rows == 0 else xs
    np.testing.assert_array_equal(np.asarray(one(p[0], table[0], x0[0], xs0)), whole[0])


def test_nan_stays_in_its_lane():
    x0 = np.ones(20)
    x0[3], x0[11] = np.nan, np.inf
    out = jax.vmap(lambda x: native_scan(lambda c, u: (jnp.sin(c) + u, None), x, jnp.zeros(5))[0])(x0)
    assert np.flatnonzero(np.isnan(out)).tolist() == [3, 11]


def test_wild_indices_do_no_harm():
    table = jnp.arange(5.0)
    wild = jnp.asarray([np.nan, np.inf, -np.inf, 1e300, -1e300, 3.0])
    body = lambda c, x: (c, table.at[(c * x).astype(jnp.int32)].get(mode="promise_in_bounds"))  # noqa: E731
    out = np.asarray(jax.vmap(lambda c: native_scan(body, c, wild, keep=True)[1])(jnp.ones(9)))
    assert out.shape == (9, 6)
    assert np.all((out[:, -1] == 3.0) & (out[:, 0] == 0.0))


def test_threads_at_once():
    p, table, x0, xs = data(40)
    run = jax.jit(jax.vmap(lambda *a: loop(native_scan, *a)[1]))
    expected = np.asarray(run(p, table, x0, xs))
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda k: np.asarray(run(p * (1 + k % 2), table, x0, xs)), range(24)))
    for k, found in enumerate(results):
        assert np.array_equal(found, expected) == (k % 2 == 0)


def test_new_lengths_and_sizes_reuse_the_machine_code():
    from plantfit.native import primitive

    body = lambda c, x: (0.125 * c + x, c)  # noqa: E731
    run = jax.vmap(lambda c, x: native_scan(body, c, x, keep=True), in_axes=(0, None))
    run(jnp.ones(64), jnp.ones(4))
    before = len(primitive._REGISTERED)
    run(jnp.ones(128), jnp.ones(9))
    assert len(primitive._REGISTERED) == before


def test_unknown_primitive_is_named_or_falls_back():
    body = lambda c, x: (jax.scipy.special.i0e(c) + x, c)  # noqa: E731
    with pytest.raises(NativeUnsupported, match="bessel_i0e") as caught:
        native_scan(body, 0.5, jnp.ones(3))
    assert isinstance(caught.value, PlantfitError)
    assert caught.value.what == "bessel_i0e"
    native, plain = native_scan(body, 0.5, jnp.ones(3), keep=True, fallback=True), lax.scan(body, 0.5, jnp.ones(3))
    np.testing.assert_allclose(native[1], plain[1])
    assert not supported(body, 0.5, jnp.ones(3))
    assert supported(lambda c, x: (c + x, c), 0.5, jax.ShapeDtypeStruct((3,), float))


def test_arrays_too_large_for_the_stack_are_refused_when_traced():
    body = lambda c, i: (c.at[i].add(1.0), None)  # noqa: E731
    with pytest.raises(NativeUnsupported, match="bytes"):
        native_scan(body, jnp.zeros(70_000), jnp.arange(3))
    np.testing.assert_allclose(native_scan(body, jnp.zeros(70_000), jnp.arange(3), fallback=True)[0][:4], [1, 1, 1, 0])


def test_other_dtypes_are_refused():
    with pytest.raises(NativeUnsupported, match="float32"):
        native_scan(lambda c, x: (c + x, None), jnp.float32(1), jnp.ones(3, jnp.float32))


@pytest.mark.parametrize("through", [jax.grad, jax.jacfwd])
def test_derivatives_are_refused_in_one_sentence(through):
    f = through(lambda c: native_scan(lambda a, x: (a * x, None), c, jnp.ones(3))[0])
    with pytest.raises(NativeUnsupported, match="derivatives"):
        f(1.0)


def test_inside_a_custom_rule():
    @jax.custom_vjp
    def total(p):
        return native_scan(lambda c, x: (c + p * x, None), 0.0, jnp.arange(4.0))[0]

    total.defvjp(lambda p: (total(p), None), lambda _, g: (6.0 * g,))
    assert float(jax.grad(total)(2.0)) == 6.0
    np.testing.assert_allclose(jax.vmap(jax.grad(total))(jnp.ones(5)), 6.0)


def test_carry_that_changes_shape_is_an_error():
    with pytest.raises(TypeError, match=r"float64\[2\]"):
        native_scan(lambda c, x: (jnp.stack([c, x]), None), 0.0, jnp.ones(3))


def test_switched_off_by_the_environment():
    code = (
        "import jax.numpy as jnp, plantfit.native as n\nassert not n.available()\n"
        "print(n.native_scan(lambda c, x: (c + x, None), 0.0, jnp.ones(3), fallback=True)[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PLANTFIT_NATIVE": "0"},
    )
    assert done.stdout.strip() == "3.0", done.stderr


def test_available_here():
    assert available()
