"""Degrees of traced functions: many in which coordinates are linear and many in which they are not, and random ones
against numbers."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.parts.quotient import quotient
from plantfit.models.parts.tables import lookup
from plantfit.problem.linear.degree import CONSTANT, coordinate
from plantfit.problem.linear.degree_rules import degrees, of

import jax
import jax.numpy as jnp

X = 1.7


def analysed(function: Callable, n: int = 4):
    """The degree of function(a (n,)) in its n entries."""
    entries = np.empty(n, dtype=object)
    entries[:] = [coordinate(i) for i in range(n)]
    return of(degrees(function, [jnp.ones(n)])(entries)[0])


def largest(function: Callable, n: int = 4) -> set[tuple[int, ...]]:
    """The largest sets of coordinates that a function is affine in jointly, of those that it depends on."""
    degree = analysed(function, n)
    seen = [i for i in range(n) if degree.seen >> i & 1]
    sets = [
        s
        for k in range(len(seen) + 1)
        for s in itertools.combinations(seen, k)
        if degree.allows(sum(1 << i for i in s))
    ]
    return {s for s in sets if not any(set(s) < set(t) for t in sets)}


def repeated(a):
    """A linear recursion in a loop."""
    return jax.lax.scan(lambda x, k: (a[0] * x + a[1] * k, x), a[2], jnp.arange(3.0))[0]


CASES = {
    "sum": (lambda a: a[0] - 2.0 * a[1] + 3.0, {(0, 1)}),
    "product": (lambda a: a[0] * a[1] + a[2], {(0, 2), (1, 2)}),
    "square": (lambda a: a[0] * a[0] + a[1], {(1,)}),
    "power": (lambda a: a[0] ** 2 + a[1] ** 1 + a[2] ** 0, {(1,)}),
    "quotient above": (lambda a: a[0] / a[1], {(0,)}),
    "custom quotient": (lambda a: quotient(a[0] + a[2], a[1]), {(0, 2)}),
    "function of another": (lambda a: a[0] * jnp.exp(-a[1] * X) + a[2], {(0, 2)}),
    "inside a function": (lambda a: jnp.sin(a[0]) + a[1], {(1,)}),
    "modulus": (lambda a: jnp.abs(a[0]) + jnp.maximum(a[1], 0.0) + a[2], {(2,)}),
    "stopped": (lambda a: jax.lax.stop_gradient(a[0]) + a[1], {(1,)}),
    "rounded": (lambda a: jnp.round(a[0]) + jnp.floor(a[1]) + a[2], {(2,)}),
    "chosen by data": (lambda a: jnp.where(X > 1.0, a[0], a[1]), {(0, 1)}),
    "chosen by itself": (lambda a: jnp.where(a[0] > 1.0, a[0], a[1]), {(1,)}),
    "clipped": (lambda a: jnp.clip(a[0], 0.0, 1.0) + a[1], {(1,)}),
    "limits of a clip": (lambda a: jnp.clip(X, a[0], a[1]) + a[2], {(2,)}),
    "entries": (lambda a: jnp.array([a[0], jnp.exp(a[1])]) @ jnp.array([1.0, 2.0]) + a[-1], {(0, 3)}),
    "all entries": (lambda a: jnp.sum(a * jnp.array([1.0, 2.0, 3.0, 4.0])), {(0, 1, 2, 3)}),
    "part": (lambda a: a[1:3].sum() * a[0], {(0,), (1, 2)}),
    "matrix": (lambda a: (a.reshape(2, 2) @ jnp.ones(2))[0] + a[3], {(0, 1, 2, 3)}),
    "transposed": (lambda a: a.reshape(2, 2).T[0, 1] * a[0], {(0,), (2,)}),
    "reversed": (lambda a: a[::-1][0] * a[0], {(0,), (3,)}),
    "picked": (lambda a: a[jnp.array([2, 0])][0] * jnp.exp(a[0]), {(2,)}),
    "inner product": (lambda a: a[:2] @ a[2:], {(0, 1), (2, 3)}),
    "product with itself": (lambda a: a @ a, {()}),
    "split": (lambda a: jnp.split(a, 2)[0].sum() * jnp.split(a, 2)[1].sum(), {(0, 1), (2, 3)}),
    "joined": (lambda a: jnp.concatenate([a[:1], jnp.exp(a[1:])])[0] + a[2], {(0, 2)}),
    "set": (lambda a: jnp.zeros(2).at[1].set(a[0])[1] + a[1], {(0, 1)}),
    "loop": (repeated, {(1, 2)}),
    "loop until": (lambda a: jax.lax.while_loop(lambda x: x < 5.0, lambda x: x + a[0], a[1]) + a[2], {(2,)}),
    "counted": (lambda a: jax.lax.fori_loop(0, 3, lambda i, x: x * X + a[0], a[1]), {(0, 1)}),
    "branch by all": (lambda a: jax.lax.cond(jnp.sum(a) < X, lambda a: a[0], lambda a: a[1], a) + a[2], {()}),
    "branch": (lambda a: jax.lax.cond(a[0] > 1.0, lambda a: a[1], lambda a: 2.0 * a[2], a), {(1, 2)}),
    "table of values": (lambda a: lookup(a[:3], (0.0, 1.0, 4.0), X) * a[3], {(0, 1, 2), (3,)}),
    "table at a value": (lambda a: lookup(jnp.array([0.0, 2.0, 3.0]), (0.0, 1.0, 4.0), a[0]) + a[1], {(1,)}),
    "jitted": (lambda a: jax.jit(lambda b, c: b * c)(a[0], a[1]), {(0,), (1,)}),
    "mapped": (lambda a: jax.vmap(lambda b: b * X)(a).sum() + a[0], {(0, 1, 2, 3)}),
    "polynomial": (lambda a: jnp.polyval(a, X), {(0, 1, 2, 3)}),
    "two products": (lambda a: a[0] * a[1] + a[1] * a[2], {(1,), (0, 2)}),
    "product of sums": (lambda a: (a[0] + a[1]) * (a[2] + a[3]), {(0, 1), (2, 3)}),
    "triple": (lambda a: a[0] * a[1] * a[2], {(0,), (1,), (2,)}),
    "integers": (lambda a: a.astype(int)[0] + a[1], {(1,)}),
    "single precision": (lambda a: a[0].astype(jnp.float32) + a[1], {(1,)}),
    "solved": (lambda a: jnp.linalg.solve(jnp.eye(2) * a[0], a[1:3])[0] + a[3], {(3,)}),
    "sorted": (lambda a: jnp.sort(a[:2])[0] + a[2], {(2,)}),
}


@pytest.mark.parametrize("name", CASES)
def test_the_largest_affine_sets_of_a_function_are_found(name):
    function, expected = CASES[name]
    assert largest(function) == expected


def test_a_custom_derivative_is_followed_through_its_function():
    @jax.custom_vjp
    def half(x):
        return 0.5 * x

    half.defvjp(lambda x: (half(x), None), lambda _, g: (0.5 * g,))
    assert largest(lambda a: half(a[0]) * jnp.exp(a[1])) == {(0,)}


def test_what_is_constant_stays_constant():
    assert of(degrees(lambda x: jnp.exp(x) * jnp.arange(3.0), [1.0])(CONSTANT)[0]) == CONSTANT


def test_many_products_count_as_nonlinear_and_nothing_is_forgotten():
    def every_pair(a):
        return sum(a[i] * a[j] for i in range(14) for j in range(i))

    degree = analysed(every_pair, 14)
    assert all(not degree.allows((1 << i) | (1 << j)) for i in range(14) for j in range(i))


def _random(rng: np.random.Generator, depth: int) -> Callable:
    if depth == 0:
        i = int(rng.integers(6))
        return (lambda a: a[i]) if i < 5 else (lambda a: jnp.asarray(X))
    kind = rng.choice(["add", "add", "mul", "div", "exp", "where", "minus"])
    f, g, h = (_random(rng, int(rng.integers(depth))) for _ in range(3))
    return {
        "add": lambda a: f(a) + g(a),
        "minus": lambda a: 2.0 * f(a) - g(a),
        "mul": lambda a: f(a) * g(a),
        "div": lambda a: f(a) / (2.0 + g(a)),
        "exp": lambda a: jnp.exp(-0.1 * f(a)),
        "where": lambda a: jnp.where(f(a) > 1.0, g(a), h(a)),
    }[str(kind)]


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.further(26)
def test_random_functions_are_affine_where_it_is_said(seed):
    rng = np.random.default_rng(seed)
    function, n = _random(rng, 5), 5
    degree = analysed(function, n)
    begin, evaluate = jnp.asarray(rng.uniform(0.5, 2.0, n)), jax.jit(jax.vmap(function))
    for bits in range(1, 1 << n):
        if degree.allows(bits):
            direction = jnp.array([float(bits >> i & 1) for i in range(n)]) * rng.uniform(-1.0, 1.0, n)
            low, middle, high = evaluate(begin + jnp.array([0.0, 0.4, 1.0])[:, None] * direction)
            np.testing.assert_allclose(middle, 0.6 * low + 0.4 * high, rtol=1e-9, atol=1e-9)
    for i in range(n):
        if not degree.seen >> i & 1:
            assert float(evaluate(begin[None])[0]) == float(evaluate(begin.at[i].add(0.7)[None])[0])
