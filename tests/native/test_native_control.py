"""Loops and branches inside the body, where lanes take their own way."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.native import native_scan

# isort: split
import jax
import jax.numpy as jnp
from jax import lax

XS = jnp.linspace(0.1, 3.0, 9)


def compare(body, carry, xs=XS, rtol=1e-13):
    """Native against lax: one lane, uniform data with a batch of carries, and a batch of data."""
    carry, xs = jax.tree.map(np.asarray, (carry, xs))
    batch = jax.tree.map(lambda v: np.stack([v * (1 + 0.1 * k) if v.dtype == float else v for k in range(19)]), carry)
    spread = jax.tree.map(lambda v: np.stack([v * (1 + 0.07 * k) for k in range(11)], -1), xs)

    @jax.jit
    def run(carry, xs, batch, spread):
        function = lambda c, x: native_scan(body, c, x, keep=True)  # noqa: E731
        ways = ((0, None), (batch, xs)), ((None, -1), (carry, spread))
        plain, native = (
            [jax.vmap(f, axes)(*given) for axes, given in ways] for f in (lambda c, x: lax.scan(body, c, x), function)
        )
        return plain, [function(carry, xs), *native]

    plain, native = run(carry, xs, batch, spread)
    first = jax.tree.map(lambda v: v[0], plain[0])  # the same as the one lane
    for a, b in zip(native, [first, *plain], strict=True):
        for m, n in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            assert m.shape == n.shape
            np.testing.assert_allclose(m, n, rtol=rtol, atol=1e-14)


def test_newton_iterations_end_lane_by_lane():
    def root(a):
        def step(s):
            x, n = s
            return 0.5 * (x + a / x), n + 1

        return lax.while_loop(lambda s: (jnp.abs(s[0] ** 2 - a) > 1e-12 * a) & (s[1] < 60), step, (1.0 + a, 0))

    compare(lambda c, x: ((c + root(x + c)[0]) * 0.5, root(x)), 1.0)


def test_while_with_a_carried_array():
    def body(c, x):
        def step(s):
            table, i = s
            return table.at[i % 4].add(x * i), i + 1

        table, i = lax.while_loop(lambda s: (s[1] < 6) & (jnp.sum(s[0]) < 20 + 10 * x), step, (c, 0))
        return table * 0.5, (i, table)

    compare(body, jnp.arange(4.0))


def test_nested_while():
    def body(c, x):
        def outer(s):
            a, k = s
            b, _ = lax.while_loop(lambda t: t[0] < a + 1.0, lambda t: (t[0] * 1.5 + 0.1, t[1] + 1), (0.2 * x, 0))
            return a + 0.3 * b, k + 1

        a, k = lax.while_loop(lambda s: (s[0] < 4.0) & (s[1] < 8), outer, (c, 0))
        return 0.1 * a, (a, k)

    compare(body, 0.3)


def test_while_that_never_runs():
    compare(lambda c, x: (lax.while_loop(lambda s: s > 1e9, lambda s: s * 2, c + x), x), 0.5)


def test_loops_of_fixed_length():
    def body(c, x):
        c = lax.fori_loop(0, 12, lambda i, s: 0.9 * s + 0.01 * i * x, c)
        total, rows = lax.scan(lambda s, w: (s + w * c, s), 0.0, jnp.arange(5.0) * x)
        back, _ = lax.scan(lambda s, w: (0.5 * s + w, None), 0.0, rows, reverse=True)
        return c, (total, rows, back)

    compare(body, 0.4)


def test_loop_with_runtime_bounds():
    compare(
        lambda c, x: (lax.fori_loop(0, (x * 3).astype(int), lambda i, s: s + jnp.sin(s) * i / 9, c) * 0.1, c),
        0.4,
        rtol=1e-11,
    )


def test_inner_scan_over_matrix_with_array_carry():
    def body(c, x):
        m = jnp.outer(c, c + x)
        last, rows = lax.scan(lambda s, row: (0.5 * s + row, jnp.dot(row, s)), c, m)
        return 0.3 * last, rows

    compare(body, jnp.asarray([0.1, 0.2, -0.3]))


@pytest.mark.parametrize("which", ["carry", "data", "constant"])
def test_branches(which):
    def body(c, x):
        index = {"carry": c, "data": x, "constant": jnp.asarray(1.0)}[which]
        y = lax.cond(index > 0.9, lambda a: jnp.exp(-a) + x, lambda a: a * 0.5, c)
        z, i = lax.switch((index * 2).astype(int), [lambda: (x, 1), lambda: (c + 1.0, 2), lambda: (y * y, 3)])
        return 0.7 * c + 0.3 * y, (y, z, i)

    compare(body, 0.8)


@pytest.mark.parametrize("handed", ["number", "constant", "of all lanes", "array", "both"])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.further(2)
def test_a_branch_that_hands_on_what_is_there(handed, inside):
    """Its lanes keep that, those of the other branch get theirs; also in a loop that some lanes have left."""
    given = {
        "number": lambda c, x: c,
        "constant": lambda c, x: jnp.asarray(0.25),
        "of all lanes": lambda c, x: 2.0 * x,
        "array": lambda c, x: jnp.stack([c, x]),
        "both": lambda c, x: c,
    }[handed]

    def chosen(c, x):
        plain, other = given(c, x), (lambda v: v) if handed == "both" else (lambda v: jnp.exp(-v) + x)
        a, n = lax.cond(jnp.sin(37.0 * c) > 0.3, lambda v: (other(v), 7), lambda v: (v, 3), plain)
        b, m = lax.cond(jnp.cos(29.0 * c) > 0.3, lambda v: (v, 1), lambda v: (other(v), 5), plain)
        return jnp.sum(a) + 0.5 * jnp.sum(b), n + m

    def body(c, x):
        if not inside:
            y, n = chosen(c, x)
            return 0.3 * y, (y, n)

        def step(s):
            a, n = s
            y, k = chosen(a, x)
            return 0.3 * y, n + k

        y, n = lax.while_loop(lambda s: s[1] < (x * 12).astype(int), step, (c, 0))
        return y, (y, n)

    compare(body, 0.6, jnp.linspace(0.1, 3.0, 40))


def test_branch_with_arrays_and_a_loop():
    def body(c, x):
        def heavy(t):
            i = lax.while_loop(lambda i: (i < 9) & (t[i % 3] + i < 4 * x), lambda i: i + 1, 0)
            return t.at[i % 3].add(1.0)

        t = lax.cond(c[0] + x > 1.5, heavy, lambda t: t * 0.5, c)
        return t * 0.9, t

    compare(body, jnp.asarray([0.2, 0.4, 0.8]))


def test_branches_under_a_running_loop():
    def body(c, x):
        def step(s):
            a, n = s
            return lax.cond(a > 2.0, lambda a: a * 0.4, lambda a: a + x, a), n + 1

        return lax.while_loop(lambda s: s[1] < (x * 4).astype(int), step, (c, 0))[0], c

    compare(body, 0.6)


def test_collatz_counts():
    def steps(n):
        return lax.while_loop(
            lambda s: s[0] != 1, lambda s: (jnp.where(s[0] % 2 == 0, s[0] // 2, 3 * s[0] + 1), s[1] + 1), (n, 0)
        )[1]

    found = jax.jit(jax.vmap(lambda n: native_scan(lambda c, _: (c, steps(c)), n, None, length=1, keep=True)[1][0]))(
        jnp.arange(1, 31)
    )
    true = []
    for n in range(1, 31):
        count = 0
        while n != 1:
            n, count = (n // 2 if n % 2 == 0 else 3 * n + 1), count + 1
        true.append(count)
    assert found.tolist() == true


def test_a_branch_that_searches_goes_vector_by_vector():
    """It reads numbers, flags, whole numbers, a table and step data from outside, and branches again inside; few
    lanes take it."""
    table = jnp.array([0.3, 1.7, 0.9, 2.2])

    def body(c, x):
        value, count = c
        rare, odd = jnp.sin(37.0 * value) > 0.8, count % 2 == 1

        def searched(value, count):
            def step(s):
                a, n = s
                return jnp.where(odd, 0.5 * (a + (x + 1.0) / a), a * 0.7 + 0.1 * table[count % 4]), n + 1

            a, n = lax.while_loop(
                lambda s: (jnp.abs(s[0] ** 2 - x - 1.0) > 1e-9) & (s[1] < 30), step, (1.0 + value**2, 0)
            )
            return lax.cond(a > 1.2, lambda a: a - x, lambda a: a + value, a), count + n

        value, count = lax.cond(rare, searched, lambda value, count: (value * 0.9 + 0.1 * x, count + 1), value, count)
        return (value, count), (value, count)

    compare(body, (0.4, 3), jnp.linspace(0.1, 3.0, 60))


def test_what_searches_in_a_branch_has_the_same_bits_in_any_batch():
    def body(c, x):
        def searched(c):
            return lax.while_loop(lambda a: jnp.abs(a * a - x) > 1e-9, lambda a: 0.5 * (a + x / a), 1.0 + c)

        c = lax.cond(jnp.sin(37.0 * c) > 0.5, searched, lambda c: 0.9 * c + 0.1 * x, c)
        return c, c

    run = jax.jit(jax.vmap(lambda c: native_scan(body, c, XS, keep=True)[1]))
    start = jnp.linspace(0.1, 2.0, 67)
    whole = np.asarray(run(start))
    for some in (slice(0, 1), slice(3, 12), slice(20, 53)):
        np.testing.assert_array_equal(run(start[some]), whole[some])


@pytest.mark.parametrize("kind", ["scan", "while"])
def test_a_loop_that_indexes_nothing_begins_at_a_carried_array(kind):
    # the array is in memory, for the body has a loop, and the inner loop takes it as numbers
    def body(c, x):
        if kind == "scan":
            end = lax.scan(lambda b, _: (0.5 * b + x, None), c, None, length=5)[0]
        else:
            end = lax.while_loop(lambda b: b[0] < 3.0, lambda b: 1.5 * b + x, c)
        return 0.1 * end, jnp.sum(end)

    compare(body, jnp.array([0.1, 0.2]))
