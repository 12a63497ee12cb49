"""Small arrays: shapes, reductions, tables read and written at indices that differ between lanes."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import lookup, lookup2
from plantfit.native import native_scan

# isort: split
import jax
import jax.numpy as jnp
from jax import lax

RNG = np.random.default_rng(3)
K = 13


def compare(body, carry, xs, axes=(0, 0), rtol=1e-13):
    """Native against lax, one by one and over a batch of 21; `axes` of carry and xs."""
    one = jax.tree.map(np.asarray, (carry, xs))
    steps = (lambda v, k: v + (k if v.dtype == int else 0.1 * k)), (lambda v, k: np.roll(v, k, axis=0))
    batch = tuple(
        jax.tree.map(lambda v, move=move: np.stack([move(v, k) for k in range(21)]), given) if axis == 0 else given
        for given, axis, move in zip(one, axes, steps, strict=True)
    )

    @jax.jit
    def run(one, batch):
        function = lambda c, x: native_scan(body, c, x, keep=True)  # noqa: E731
        many, plain = (jax.vmap(f, in_axes=axes)(*batch) for f in (function, lambda c, x: lax.scan(body, c, x)))
        return function(*one), many, plain

    alone, many, plain = run(one, batch)
    first = jax.tree.map(lambda v: v[0], plain)  # the same as the one
    for found, expected in ((alone, first), (many, plain)):
        for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert x.dtype == y.dtype
            assert x.shape == y.shape
            np.testing.assert_allclose(x, y, rtol=rtol, atol=1e-13)


TABLE = jnp.asarray(RNG.normal(size=7))
GRID = jnp.asarray(RNG.normal(size=(4, 5)))

INDEXED = {
    "square brackets": lambda i: TABLE[i],
    "promise": lambda i: TABLE.at[jnp.clip(i, 0, 6)].get(mode="promise_in_bounds"),
    "clip": lambda i: TABLE.at[i].get(mode="clip"),
    "fill": lambda i: TABLE.at[i].get(mode="fill"),
    "fill value": lambda i: TABLE.at[i].get(mode="fill", fill_value=-3.0),
    "two axes": lambda i: GRID[i % 4, (i + 1) % 5],
    "row": lambda i: jnp.sum(GRID[i % 4] ** 2),
    "window": lambda i: lax.dynamic_slice(TABLE, (i,), (3,)),
    "window of two": lambda i: lax.dynamic_slice(GRID, (i, 1), (2, 3)),
    "take": lambda i: jnp.take(TABLE, jnp.stack([i, i + 1]), mode="clip"),
    "integers": lambda i: jnp.arange(3, 10)[i],
    "bools": lambda i: jnp.asarray([True, False, True])[i],
    "literal table": lambda i: jnp.asarray(np.array([1.0, 4.0, 9.0]))[i],
    "written": lambda i: TABLE.at[i].set(7.0),
    "added": lambda i: TABLE.at[i].add(7.0),
    "added twice": lambda i: TABLE.at[jnp.stack([i, i])].add(jnp.asarray([1.0, 2.0])),
    "clipped write": lambda i: TABLE.at[i].set(7.0, mode="clip"),
    "dropped write": lambda i: TABLE.at[i].set(7.0, mode="drop"),
    "row write": lambda i: GRID.at[i % 4].add(1.0),
    "window write": lambda i: lax.dynamic_update_slice(GRID, jnp.ones((2, 2)), (i, 2)),
    "read after write": lambda i: TABLE.at[i].set(2.0)[(i + 1) % 7] + TABLE[i % 7],
    "one-hot": lambda i: jax.nn.one_hot(i, 4) @ jnp.arange(4.0),
}


@pytest.mark.parametrize("name", INDEXED)
@pytest.mark.further(7)
def test_indexing(name):
    def body(c, i):
        value = INDEXED[name](i + c)
        return c, value

    compare(body, 0, np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 20, -1, -3, -9]))


SHAPES = {
    "outer": lambda v: v[:, None] * v[None, :],
    "transpose": lambda v: v.reshape(2, 3).T,
    "concatenate": lambda v: jnp.concatenate([v, v[::-1]]),
    "stack": lambda v: jnp.stack([v[0], v[5], v[2]]),
    "sum": jnp.sum, "max": jnp.max, "min": jnp.min, "prod": jnp.prod, "mean": jnp.mean,
    "any": lambda v: jnp.any(v > 1), "all": lambda v: jnp.all(v > -9), "argmin": jnp.argmin, "argmax": jnp.argmax,
    "rows": lambda v: jnp.sum(v.reshape(2, 3), axis=1),
    "cumsum": jnp.cumsum, "cumprod": jnp.cumprod,
    "matrix": lambda v: v.reshape(2, 3) @ v.reshape(3, 2),
    "matvec": lambda v: v.reshape(2, 3) @ v[:3],
    "einsum": lambda v: jnp.einsum("bi,bij->bj", v.reshape(3, 2), jnp.ones((3, 2, 2)) * v[0]),
    "iota": lambda v: jnp.arange(6) * v,
    "pad": lambda v: jnp.pad(v, (1, 2), constant_values=3.0),
    "where": lambda v: jnp.where(v > 0, v, -v),
    "strided": lambda v: v[1::2],
    "flip": lambda v: jnp.flip(v.reshape(2, 3), 0),
    "searchsorted": lambda v: jnp.searchsorted(jnp.arange(5.0), v[0], method="compare_all"),
    "interp": lambda v: jnp.interp(v[0], jnp.arange(5.0), jnp.arange(5.0) ** 2),
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.further(6)
def test_shapes(name):
    def body(c, x):
        c = 0.9 * c + x
        return c, SHAPES[name](c)

    compare(body, jnp.asarray(RNG.normal(size=6)), jnp.asarray(RNG.normal(size=(K, 6))), rtol=1e-10)


@pytest.mark.parametrize("nodes", [tuple(np.linspace(0, 2, 6)), (0.0, 0.1, 0.7, 1.5, 2.0)])
def test_lookup_value_and_slope(nodes):
    values = jnp.asarray(RNG.normal(size=len(nodes)))

    def body(c, x):
        y, slope = jax.jvp(lambda a: lookup(values, nodes, a), (c,), (1.0,))
        return 0.7 * c + x, (y, slope)

    compare(body, 0.3, np.append(np.linspace(-2, 3, K - 1), np.nan))


def test_lookup_over_two_signals():
    nodes = ((0.0, 1.0, 3.0), (0.0, 0.5, 1.0, 2.0))
    values = jnp.asarray(RNG.normal(size=(3, 4)))
    compare(lambda c, x: (0.5 * c + x, lookup2(values, nodes, c, x)), 0.3, np.linspace(-1, 2, K))


def test_gradient_of_a_table_is_accumulated():
    nodes = tuple(np.linspace(0, 2, 9))

    def body(c, x):
        gradient, state = c
        _, pull = jax.vjp(lambda t: lookup(t, nodes, state), jnp.sin(jnp.arange(9.0)))
        (more,) = pull(x)
        return (gradient + more, 0.8 * state + x), gradient[3]

    compare(body, (jnp.zeros(9), 0.2), np.linspace(0, 1, K))


@pytest.mark.thorough
def test_scatter_into_a_carried_table():
    def body(c, x):
        table, i = c
        before = table[i]
        table = table.at[i].add(x * jnp.sin(before))
        return (table, (i + 3) % 100), before + table[(i + 1) % 100]

    compare(body, (jnp.arange(100.0), 5), np.linspace(0, 1, K))


def test_arrays_that_change_places():
    def body(c, x):
        a, b = c
        i = (x * 10).astype(int) % 3
        return (b.at[i].set(x), a), a[i] - b[0]

    compare(body, (jnp.arange(3.0), -jnp.arange(3.0)), np.linspace(0, 1, K))


def test_old_and_new_version_of_an_array():
    def body(c, x):
        new = c.at[(x * 10).astype(int) % 4].add(x)
        return new, (c[1], new, c)

    compare(body, jnp.arange(4.0), np.linspace(0, 1, K))


def test_large_constant_table():
    table = jnp.asarray(RNG.normal(size=20_000))
    compare(lambda c, i: (c + 1, table[i * 1000 + c]), 0, np.arange(K))


def test_large_tables_that_differ_between_lanes():
    tables = jnp.asarray(RNG.normal(size=(5, 3, 6000)))
    f = lambda scan: jax.vmap(jax.vmap(lambda t: scan(lambda c, i: (c + t[i * 400], None), 0.0, jnp.arange(K))[0]))  # noqa: E731
    np.testing.assert_allclose(jax.jit(f(native_scan))(tables), jax.jit(f(lax.scan))(tables))


def test_ring_buffer():
    def body(c, x):
        buffer, at = c
        late = buffer[at]
        return (buffer.at[at].set(x + 0.5 * late), jnp.where(at == 4, 0, at + 1)), late

    compare(body, (jnp.zeros(5), 0), np.sin(np.arange(float(K))), axes=(None, 0))
