"""The exponential step: its formula, its order, its behaviour on stiff plants, its derivatives."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulate_events_plants import plant

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.exponential import exponential

import jax
import jax.numpy as jnp

STEP = 1e-30


def chain(n, dense):
    """n states, each fed by the one before it (and by all others when `dense`), a cubic loss; u enters the first, v
    the last."""
    names = [f"x{i}" for i in range(n)]
    weights = np.random.default_rng(n).normal(size=(n, n)) * (1.0 if dense else np.eye(n, k=-1)) - 2.0 * np.eye(n)

    def derivative(x, u, p):
        feed = {0: u["u"]} | {n - 1: u["v"]}
        return {
            a: sum(weights[i, j] * x[b] for j, b in enumerate(names) if weights[i, j])
            - p["c"] * x[a] * x[a] * x[a]
            + feed.get(i, 0.0)
            for i, a in enumerate(names)
        }

    return plant(" ".join(names), "u v", "c", derivative), derivative


def formula(derivative, names, x, u0, u1, h, c):
    """(I - 2/3 Z + 1/6 Z^2) v = f + d/2 - Z (f + d)/6, x + h v, with a dense solver and complex differences."""

    def f(x, u):
        rates = derivative(dict(zip(names, x, strict=True)), dict(zip("uv", u, strict=True)), {"c": c})
        return np.array([complex(rates[n]) for n in names])

    z = h * np.column_stack([np.imag(f(x + 1j * STEP * e, u0)) / STEP for e in np.eye(len(x))])
    here, d = np.real(f(x, u0)), np.imag(f(x, u0 + 1j * STEP * (u1 - u0))) / STEP
    return x + h * np.linalg.solve(np.eye(len(x)) - 2 / 3 * z + z @ z / 6, here + d / 2 - z @ (here + d) / 6)


def one_step(vector, x, u0, u1, h, c, varying, pattern):
    return np.array(stepper(vector, varying, pattern)(tuple(x), (*u0, 0.0), (*u1, 0.0), h, (c,)))  # 0: the time


@cache
def stepper(vector, varying, pattern):
    return jax.jit(lambda x, u0, u1, h, p: exponential(vector.rate, x, u0, u1, h, p, varying, pattern))


@pytest.mark.parametrize(
    ("n", "varying", "dense"),
    [
        pytest.param(n, varying, dense, marks=pytest.mark.slow if n == 5 and not (varying and dense) else ())
        for n in (1, 2, 3, 5)
        for varying in (False, True)
        for dense in (False, True)
    ],
)
@pytest.mark.further(10)
def test_a_step_is_the_formula_with_and_without_a_pattern(n, varying, dense):
    vector, derivative = chain(n, dense)
    rng = np.random.default_rng(n)
    x, u0, u1 = rng.normal(size=n), rng.normal(size=2), rng.normal(size=2)
    u1 = u1 if varying else u0
    for h in (0.0, 0.03, 2.0, 500.0):
        expected = formula(derivative, vector.states, x, u0, u1, h, 0.3)
        for pattern in (vector.pattern, None):
            np.testing.assert_allclose(
                one_step(vector, x, u0, u1, h, 0.3, varying, pattern), expected, rtol=1e-10, atol=1e-11
            )


def test_elimination_swaps_rows_where_the_first_pivot_vanishes():
    # Z with (I - 2/3 Z + Z^2/6)[0][0] = 0: a rotation in three states
    a = np.array([[0.0, 2.0, 0.0], [-3.0, 0.0, 0.0], [0.5, 0.0, -1.0]])
    names = ("x0", "x1", "x2")

    def derivative(x, u, p):
        return {
            n: sum(a[i, j] * x[m] for j, m in enumerate(names)) + (u["u"] if i == 0 else 0.0)
            for i, n in enumerate(names)
        }

    vector = plant("x0 x1 x2", "u v", "c", derivative)
    x, u = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.0])
    assert abs((np.eye(3) - 2 / 3 * a + a @ a / 6)[0, 0]) < 1e-15
    expected = formula(derivative, names, x, u, u, 1.0, 0.0)
    for pattern in (vector.pattern, None):
        np.testing.assert_allclose(one_step(vector, x, u, u, 1.0, 0.0, False, pattern), expected, rtol=1e-12)


def final(vector, x0, u, steps, varying, c, duration=2.0):
    """State at the end, by `steps` equal steps under u(t) (2, ...) linear between the ends of every step."""
    t = np.linspace(0.0, duration, steps + 1)
    values = np.array([u(s) for s in t])
    values = values if varying else np.broadcast_to(u(0.0), values.shape)

    def body(x, row):
        a, b = row
        return exponential(
            vector.rate, x, (a[0], a[1], 0.0), (b[0], b[1], 0.0), duration / steps, (c,), varying, vector.pattern
        ), None

    return np.array(jax.lax.scan(body, tuple(map(jnp.asarray, x0)), (values[:-1], values[1:]))[0])


@pytest.mark.parametrize(
    ("varying", "c", "order"),
    [(False, 0.8, 2), (True, 0.8, 2), (False, 0.0, 3), (True, 0.0, 3)],
    ids=["nonlinear, held", "nonlinear, linear input", "linear, held", "linear, linear input"],
)
def test_order(varying, c, order):
    vector, derivative = chain(3, True)
    x0, names = np.array([0.8, -0.5, 0.3]), vector.states

    def u(s):
        return np.array([0.7 + (0.9 * s if varying else 0.0), -0.4 - (0.5 * s if varying else 0.0)])

    def f(s, x):
        rates = derivative(dict(zip(names, x, strict=True)), dict(zip("uv", u(s), strict=True)), {"c": c})
        return [rates[n] for n in names]

    exact = solve_ivp(f, (0.0, 2.0), x0, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    errors = [np.linalg.norm(final(vector, x0, u, n, varying, c) - exact) for n in (32, 64, 128)]
    measured = np.log2(np.array(errors[:-1]) / errors[1:])
    print(f"order measured: {measured}")
    assert np.all(np.abs(measured - order) < 0.15)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_one_huge_step_lands_at_rest(n):
    vector, _ = chain(n, False)
    x, u = np.full(n, 3.0), np.array([1.0, 1.0])
    for h, tolerance in ((1e4, 1e-3), (1e8, 1e-7), (1e12, 1e-10)):
        landed = one_step(vector, x, u, u, h, 0.0, False, vector.pattern)
        rest = vector.rate(tuple(landed), (*u, 0.0), (0.0,))
        assert np.max(np.abs(rest)) < tolerance


def test_decay_is_the_rational_function_of_radau():
    vector = plant("x", "u", "a", lambda x, u, p: {"x": -p["a"] * x["x"]})
    for z in (-0.1, -1.0, -10.0, -1e3, -1e6):
        step = exponential(
            vector.rate, (jnp.asarray(1.0),), (0.0, 0.0), (0.0, 0.0), 1.0, (jnp.asarray(-z),), False, vector.pattern
        )
        assert float(step[0]) == pytest.approx((1 + z / 3) / (1 - 2 * z / 3 + z * z / 6), rel=1e-9)
        assert abs(float(step[0])) < 1.0


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.further(1)
def test_derivatives_by_state_inputs_step_and_parameter(n):
    vector, _ = chain(n, True)
    rng = np.random.default_rng(7)
    at = jnp.asarray(np.r_[rng.normal(size=n + 4), 0.2, 0.3])
    weights = jnp.asarray(rng.normal(size=n))

    def value(v):
        x, u0, u1, h, c = v[:n], v[n : n + 2], v[n + 2 : n + 4], v[-2], v[-1]
        y = exponential(vector.rate, tuple(x), (u0[0], u0[1], 0.0), (u1[0], u1[1], 0.0), h, (c,), True, vector.pattern)
        return sum(w * a for w, a in zip(weights, y, strict=True))

    value_of, e = jax.jit(value), 1e-3 * np.eye(n + 6)
    central = lambda s: np.array([(value_of(at + s * d) - value_of(at - s * d)) / (2e-3 * s) for d in e])  # noqa: E731
    expected = (4 * central(0.5) - central(1.0)) / 3
    np.testing.assert_allclose(jax.jit(jax.grad(value))(at), expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(value))(at), expected, rtol=1e-7, atol=1e-8)
