"""The exponential step of two states, which has a closed form, against numpy, fractions and the general form."""

from fractions import Fraction

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Model
from plantfit.models.parts.tables import Table, lookup, shared_lookups
from plantfit.simulate.steps.exponential import exponential, solution
from plantfit.simulate.steps.vector import vectorise

import jax
import jax.numpy as jnp

STIFF = [[-1e6, 3e5], [1.0, -2.0]]
OSCILLATING = [[0.0, 40.0], [-50.0, -0.3]]
CASES = {
    "any": np.random.default_rng(0).normal(size=(2, 2)),
    "large": 1e4 * np.random.default_rng(1).normal(size=(2, 2)),
    "stiff": np.array(STIFF),
    "oscillating": np.array(OSCILLATING),
    "double integrator": np.array([[0.0, 1.0], [0.0, 0.0]]),
    "at rest": np.zeros((2, 2)),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("d", [(0.0, 0.0), (0.7, 0.0), (-0.4, 1.3)])
def test_it_solves_the_equation(name, d):
    z, f = CASES[name], np.array([1.2, -0.7])
    matrix = np.eye(2) - 2 / 3 * z + z @ z / 6
    wanted = np.linalg.solve(matrix, f + np.array(d) / 2 - z @ (f + d) / 6)
    rows = [[float(a) for a in row] for row in z]  # zeros stay Python floats, as the pattern of a model leaves them
    found = solution(
        [[a and jnp.asarray(a) for a in row] for row in rows], (1.0, 1.0, [*map(jnp.asarray, f)]), (0.5, 1.0, d)
    )
    condition = np.linalg.cond(matrix)
    np.testing.assert_allclose(found, wanted, rtol=1e-14 * max(10.0, condition))
    residual = matrix @ np.asarray(found) - (f + np.array(d) / 2 - z @ (f + d) / 6)
    assert np.max(np.abs(residual)) < 1e-14 * np.max(np.abs(matrix)) * max(1.0, np.max(np.abs(found)))


def exact_slopes(z, f, d, w):
    """w.dv by every entry of Z, f and d, of M v = f + d/2 - Z (f + d)/6, in fractions: -w^T M^-1 (dM v - dr)."""
    n, part = len(f), Fraction
    z, f, d, w = [[part(a) for a in row] for row in z], *([part(a) for a in row] for row in (f, d, w))
    times = lambda m, y: [sum(a * b for a, b in zip(row, y, strict=True)) for row in m]  # noqa: E731
    square = [[sum(z[i][k] * z[k][j] for k in range(n)) for j in range(n)] for i in range(n)]
    matrix = [[(i == j) - part(2, 3) * z[i][j] + square[i][j] / 6 for j in range(n)] for i in range(n)]
    moved = [a + b for a, b in zip(f, d, strict=True)]
    v = solved(matrix, [a + b / 2 - c / 6 for a, b, c in zip(f, d, times(z, moved), strict=True)])
    adjoint = solved([list(column) for column in zip(*matrix, strict=True)], w)
    zv, zw = times(z, v), times([list(column) for column in zip(*z, strict=True)], adjoint)
    by_z = [
        [a * (part(2, 3) * v[j] - (zv[j] + moved[j]) / 6) - b * v[j] / 6 for j in range(n)]
        for a, b in zip(adjoint, zw, strict=True)
    ]
    by_f = [a - b / 6 for a, b in zip(adjoint, zw, strict=True)]
    by_d = [a / 2 - b / 6 for a, b in zip(adjoint, zw, strict=True)]
    return [np.array(a, dtype=float) for a in (by_z, by_f, by_d)]


def solved(matrix, right):
    """Elimination in fractions."""
    rows = [[*row, b] for row, b in zip(matrix, right, strict=True)]
    for c in range(len(rows)):
        pivot = max(range(c, len(rows)), key=lambda r: abs(rows[r][c]))
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [a / rows[c][c] for a in rows[c]]
        rows = [
            row if r == c else [a - row[c] * b for a, b in zip(row, rows[c], strict=True)] for r, row in enumerate(rows)
        ]
    return [row[-1] for row in rows]


@pytest.mark.parametrize(
    ("n", "stiffness", "bar"),
    [(1, 1e8, 1e-14), (2, 1.0, 1e-14), (2, 1e3, 1e-12), (2, 1e6, 1e-9), (3, 1.0, 1e-13), (3, 1e3, 1e-10)],
)
@pytest.mark.further(5)
def test_derivatives_of_stiff_steps_are_exact_but_for_rounding(n, stiffness, bar):
    """Against fractions: forwards and backwards, by Z, the rates and their change, of eigenvectors that lie
    anywhere."""

    def weighed(z, f, d, w):
        found = solution([[*row] for row in z], (1.0, 1.0, [*f]), (0.5, 1.0, [*d]))
        return sum(a * b for a, b in zip(w, found, strict=True))

    slopes = jax.jit(lambda *at: [of(weighed, argnums=(0, 1, 2))(*at) for of in (jax.grad, jax.jacfwd)])
    rng = np.random.default_rng(n)
    for _ in range(20):
        turned = np.linalg.qr(rng.normal(size=(n, n)))[0]
        z = turned @ np.diag(-np.r_[stiffness, rng.uniform(0.1, 1.0, n - 1)]) @ turned.T + 0.1 * rng.normal(size=(n, n))
        f, d, w = rng.normal(size=(3, n))
        wanted = exact_slopes(z, f, d, w)
        for each in slopes(z, f, d, w):
            for found, one in zip(each, wanted, strict=True):
                assert np.max(np.abs(found - one)) < bar * np.max(np.abs(one))


def test_steps_and_slopes_equal_those_of_three_states_with_an_idle_one():
    """The general form is used as soon as there is a third state."""

    def rate(x, u, p):
        return (x[1], -p * jnp.sin(x[0]) * 30.0 - 0.4 * x[1] + u[0])

    def idle(x, u, p):
        return (*rate(x, u, p), -1.0 * x[2])

    def step(rate, x, p):
        return exponential(rate, x, (1.0,), (1.5,), 0.05, p, True)

    x, p = (0.3, -0.2), 1.7

    def slopes(f):
        each = [jax.value_and_grad(lambda *a, k=k: f(*a)[k], argnums=(0, 1)) for k in range(2)]
        return jax.jit(lambda x, p: [slope(x, p) for slope in each])

    pair = slopes(lambda x, p: step(rate, x, p))(x, p)
    three = slopes(lambda x, p: step(idle, (*x, 1.0), p))(x, p)
    np.testing.assert_allclose(jax.tree.leaves(pair), jax.tree.leaves(three), rtol=1e-12)


def test_a_place_in_tables_that_is_looked_up_once_keeps_values_and_slopes():
    nodes, other = (0.0, 1.0, 2.5, 4.0), (0.0, 2.0, 4.0)
    values = [jnp.asarray(np.random.default_rng(k).normal(size=4)) for k in range(2)]

    def apart(x, values):
        return lookup(values[0], nodes, x) * lookup(values[1], nodes, x) + lookup(values[0][:3], other, x) * lookup(
            values[1], nodes, 0.5 * x
        )

    def together(x, values):
        with shared_lookups():
            return apart(x, values)

    of = [
        jax.jit(lambda x, v, f=f: (jax.value_and_grad(f, argnums=(0, 1))(x, v), jax.grad(jax.grad(f))(x, v)))
        for f in (apart, together)
    ]
    for x in (-0.5, 0.0, 1.0, 1.7, 3.9, 4.0, 5.0):
        a, b = (f(x, values) for f in of)
        np.testing.assert_allclose(jax.tree.leaves(a)[0], jax.tree.leaves(b)[0], rtol=0)
        for s, t in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            np.testing.assert_allclose(s, t, rtol=1e-14, atol=1e-15)


def branching(share_inside):
    """A model that reads one table inside a branch and, at the same place, outside of it."""
    table = Table("k", ("x",), ((0.0, 1.0, 2.0, 4.0),))

    def derivative(x, u, p):
        extra = jax.lax.cond(x["x"] > share_inside, lambda: table(p["k"], x["x"]), lambda: jnp.zeros(()))
        return {"x": u["u"] - table(p["k"], x["x"]) * x["x"] - extra}

    return Model(
        name="branching", states={"x": ""}, inputs={"u": ""}, outputs={"y": ""}, tables=(table,),
        parameters=(Declared("k", "", (0.1, 2.0), shape=table.shape),),
        derivative=derivative, output=lambda x, u, p: {"y": x["x"]},
    )  # fmt: skip


def test_a_table_may_be_read_inside_a_branch_and_outside_of_it():
    vector = vectorise(branching(0.5))
    values = jnp.asarray([0.5, 1.0, 0.8, 0.3])
    f = lambda x, k: exponential(vector.rate, (x,), (1.0, 0.0), (1.0, 0.0), 0.1, (k,), False)[0]  # noqa: E731
    found, slopes = jax.jit(jax.value_and_grad(f, argnums=1))(0.7, values)
    value = jax.jit(f)
    moved = [float(value(0.7, values.at[1].add(s * 1e-6))) for s in (1, -1)]
    assert found == pytest.approx(sum(moved) / 2, rel=1e-12)
    assert slopes[1] == pytest.approx((moved[0] - moved[1]) / 2e-6, rel=1e-7)
