"""Gradients of tables, added up in the carry: a scatter onto zeros that is added to an array must equal lax.scan's."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.tables import lookup, lookup2
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


def in_branches(carry, row):
    """Sums in both branches of a condition that lanes share, in one of them at two places."""
    x, late = row

    def near(k, a):
        return k.at[jnp.int32(x)].add(x).at[jnp.int32(x) + 1].add(1.0 - x), a + x

    def far(k, a):
        at = jnp.minimum(jnp.int32(0.5 * x), 4)
        return k.at[at].add(x * x), a

    return jax.lax.cond(late, far, near, *carry), None


XS = jnp.asarray(np.random.default_rng(3).uniform(0.0, 4.5, (40, 60)))
LATE = jnp.asarray(np.random.default_rng(4).uniform(size=60) < 0.3)
BEGIN = jnp.linspace(-1.0, 1.0, 6), jnp.asarray(0.0)


@NEEDED
def test_sums_in_branches_stay_in_place_and_equal_those_of_lax():
    late = jnp.asarray(np.random.default_rng(5).uniform(size=(40, 60)) < 0.3)
    for flags, axis in ((LATE, None), (late, 0)):  # lanes take the same branch, or their own
        own = jax.jit(jax.vmap(lambda x, b: native_scan(in_branches, BEGIN, (x, b))[0], in_axes=(0, axis)))(XS, flags)
        plain = jax.jit(jax.vmap(lambda x, b: jax.lax.scan(in_branches, BEGIN, (x, b))[0], in_axes=(0, axis)))(
            XS, flags
        )
        for a, b in zip(own, plain, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)


@NEEDED
def test_held_sums_of_a_lane_have_the_same_bits_in_every_batch():
    run = jax.jit(jax.vmap(lambda x: native_scan(in_branches, BEGIN, (x, LATE))[0]))
    whole = run(XS)
    for part in (slice(0, 1), slice(3, 8), slice(7, 40)):
        for a, b in zip(run(XS[part]), whole, strict=True):
            np.testing.assert_array_equal(a, b[part])
    alone = jax.jit(lambda x: native_scan(in_branches, BEGIN, (x, LATE))[0])(XS[5])
    for a, b in zip(alone, whole, strict=True):
        np.testing.assert_array_equal(a, b[5])


@NEEDED
def test_a_table_that_the_loop_reads_is_never_held_back():
    def body(carry, x):
        k, total = carry
        at = jnp.int32(x)
        k = k.at[at].add(x)
        return (k, total + k[at] * k[0]), None

    own = jax.jit(jax.vmap(lambda x: native_scan(body, BEGIN, x)[0]))(XS)
    plain = jax.jit(jax.vmap(lambda x: jax.lax.scan(body, BEGIN, x)[0]))(XS)
    for a, b in zip(own, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)


@NEEDED
def test_a_branch_that_needs_the_old_table_gets_it():
    def body(carry, row):
        k, total = carry
        x, late = row
        at = jnp.int32(x)
        new = jax.lax.cond(late, lambda k: k.at[at].add(x), lambda k: k, k)
        return (new, total + k[at]), None  # read after the branch: it may not have been overwritten

    own = jax.jit(jax.vmap(lambda x: native_scan(body, BEGIN, (x, LATE))[0]))(XS)
    plain = jax.jit(jax.vmap(lambda x: jax.lax.scan(body, BEGIN, (x, LATE))[0]))(XS)
    for a, b in zip(own, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)


@NEEDED
@pytest.mark.parametrize("reverse", [False, True])
def test_steps_behind_the_used_ones_are_left_out(reverse):
    used = jnp.asarray([60, 0, 1, 31, 59])
    xs = XS[:10].reshape(5, 2, 60)

    def body(carry, x):
        return 0.8 * carry + jnp.sin(x), carry

    def one(x, end):
        return native_scan(body, jnp.asarray(0.5), x, keep=True, reverse=reverse, used=end)

    last, before = jax.jit(jax.vmap(jax.vmap(one, in_axes=(0, None)), in_axes=(0, 0)))(xs, used)
    for row, n in enumerate(used.tolist()):
        for lane in range(2):
            wanted, kept = jax.lax.scan(body, jnp.asarray(0.5), xs[row, lane, :n], reverse=reverse)
            np.testing.assert_allclose(last[row, lane], wanted, rtol=1e-13)
            np.testing.assert_allclose(before[row, lane, :n], kept, rtol=1e-13)


def sums_and_rows(x, end, reverse=False):
    return native_scan(
        lambda c, x: (c + x, c), jnp.asarray(0.0), x, keep=True, reverse=reverse, used=end, fallback=True
    )


@pytest.mark.parametrize("reverse", [False, True])
def test_without_native_code_steps_behind_the_used_ones_are_left_out_too(monkeypatch, reverse):
    monkeypatch.setattr("plantfit.native.scan.available", lambda: False)
    last, _ = sums_and_rows(jnp.asarray([1.0, 2.0, np.nan]), jnp.asarray(2), reverse)
    assert float(last) == 3.0


@NEEDED
def test_a_loop_that_leaves_native_code_for_its_tables_leaves_out_the_same_steps():
    tables = jnp.asarray(np.random.default_rng(6).normal(size=(3, 5000)))  # too large where lanes have their own

    def one(table, end):
        return native_scan(lambda c, x: (c + table[jnp.int32(x)], None), jnp.asarray(0.0), rows, used=end)[0]

    rows = jnp.asarray([7.0, 4999.0, 30.0, 2.0])
    found = jax.jit(jax.vmap(one))(tables, jnp.asarray([4, 2, 0]))
    picked = np.asarray(tables)[:, [7, 4999, 30, 2]]
    np.testing.assert_allclose(found, [picked[0].sum(), picked[1, :2].sum(), 0.0], rtol=1e-14, atol=1e-14)


def shares(carry, row):
    """What the slope of a linear table gives to both its neighbours: what one of them does not get, the other gets."""
    k, more = carry
    x, b, s = row
    at = jnp.minimum(jnp.int32(x), 4)
    w = x - at
    second = w * b + 0.7 * s
    other = 0.3 * b - w * s
    return (k.at[at].add(b - second).at[at + 1].add(second), more.at[at].add(other).at[at + 1].add(-(w * other))), None


def slow_walks(lanes, steps):
    """Places (lanes, steps) that change seldom, in one lane at a time; one lane stays, one stands at the end of the
    table."""
    rng = np.random.default_rng(6)
    x = np.clip(2.5 + np.cumsum(rng.normal(0.0, 0.1, (lanes, steps)), axis=1), 0.0, 4.99)
    x[1], x[2] = 1.25, 5.0
    return jnp.asarray(x), jnp.asarray(rng.normal(size=(lanes, steps))), jnp.asarray(rng.normal(size=(lanes, steps)))


@NEEDED
@pytest.mark.parametrize("lanes", [1, 3, 8, 20, 37])
@pytest.mark.further(4)
def test_shares_of_two_neighbours_are_kept_as_their_sum_and_one_of_them(lanes):
    rows = slow_walks(max(lanes, 3), 200)
    rows = tuple(a[:lanes] for a in rows)
    begin = jnp.linspace(-1.0, 1.0, 6), jnp.zeros(6)
    own = jax.jit(jax.vmap(lambda *row: native_scan(shares, begin, row)[0]))(*rows)
    plain = jax.jit(jax.vmap(lambda *row: jax.lax.scan(shares, begin, row)[0]))(*rows)
    for a, b in zip(own, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-13 * np.max(np.abs(b)))
    alone = jax.jit(lambda *row: native_scan(shares, begin, row)[0])(*(a[lanes - 1] for a in rows))
    for a, b in zip(alone, own, strict=True):
        np.testing.assert_array_equal(a, b[lanes - 1])


@NEEDED
def test_shares_that_a_lane_gives_to_one_neighbour_alone_leave_nothing_at_the_other():
    x, b = jnp.full((9, 50), 3.0), jnp.asarray(np.random.default_rng(7).normal(size=(9, 50)))
    found = jax.jit(jax.vmap(lambda *row: native_scan(shares, (jnp.zeros(6), jnp.zeros(6)), row)[0][0]))(x, b, 0.0 * b)
    np.testing.assert_array_equal(found[:, jnp.array([0, 1, 2, 4, 5])], 0.0)
    np.testing.assert_allclose(found[:, 3], jnp.sum(b, axis=1), rtol=1e-13)
