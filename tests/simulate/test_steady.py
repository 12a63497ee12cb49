"""Steady states against closed forms, scipy's brentq and finite differences."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from simulate_events_plants import MOTOR, motor, plant, tank

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.simulate.steady import rest_channels, steady_outputs, steady_states

import jax
import jax.numpy as jnp


@cache
def tanh_pair():
    """Two coupled states with a saturating and a tabulated law."""

    def derivative(x, u, p):
        return {
            "a": (p["g"] * jnp.tanh(u["u"] - x["b"]) - x["a"]) / 0.01,
            "b": x["a"]
            - p["c"] * jnp.interp(x["b"], jnp.array([-2.0, 0.0, 1.0, 3.0]), jnp.array([-1.0, 0.0, 2.0, 3.0])),
        }

    return plant("a b", "u", "g c", derivative)


@jax.jit
def pair_at_rest(u, gains):
    return steady_states(tanh_pair(), (u, 0.0), gains, (0.0, 0.0))


def test_motor_at_rest_is_its_closed_form():
    r, _, k, _, b = MOTOR
    v, load = np.linspace(-12, 12, 7), np.linspace(0, 0.01, 7)
    i, w = steady_states(motor(), rest_channels(motor(), {"v": v, "load": load}), MOTOR, (0.0, 0.0))
    det = r * b + k * k
    np.testing.assert_allclose(i, (b * v + k * load) / det, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(w, (k * v - r * load) / det, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_tank_from_its_singular_empty_start(scale):
    """sqrt has an infinite slope at the guess 0; the answer scales with the square of the inflow."""
    q = scale * np.array([0.5, 1.0, 3.0])
    levels = steady_outputs(tank(), (2.0, 5.0), {"q": q})["h"]
    np.testing.assert_allclose(levels, (q / 2.0) ** 2, rtol=1e-7)


@pytest.mark.thorough
def test_saturating_and_tabulated_laws_against_brentq():
    u = jnp.linspace(-4, 4, 9)
    a, b = pair_at_rest(u, (1.5, 0.8))

    def table(x):
        return np.interp(x, [-2.0, 0.0, 1.0, 3.0], [-1.0, 0.0, 2.0, 3.0])

    expected = np.array(
        [brentq(lambda y, v=v: 1.5 * np.tanh(v - y) - 0.8 * table(y), -10, 10, xtol=1e-14) for v in u], dtype=float
    )
    np.testing.assert_allclose(b, expected, atol=1e-10)
    np.testing.assert_allclose(a, 0.8 * table(expected), atol=1e-10)


@pytest.mark.thorough
def test_order_of_points_and_batching_do_not_matter():
    u = jnp.linspace(-4, 4, 9)
    answer, turned = (pair_at_rest(v, (1.5, 0.8)) for v in (u, u[::-1]))
    np.testing.assert_allclose(answer[1], turned[1][::-1], atol=1e-13)
    gains = jnp.array([0.7, 1.5])
    batch = jax.jit(jax.vmap(lambda g: pair_at_rest(u, (g, 0.8))))(gains)
    np.testing.assert_allclose(batch[1][1], answer[1], atol=1e-13)


@pytest.mark.thorough
def test_derivatives_against_finite_differences():
    u = jnp.linspace(-3, 3.1, 9)

    def outputs(q):
        return jnp.stack(pair_at_rest(u + q[2], (q[0], q[1])))

    q = jnp.array([1.5, 0.8, 0.0])
    step = 1e-6
    numeric = [(outputs(q.at[k].add(step)) - outputs(q.at[k].add(-step))) / (2 * step) for k in range(3)]
    for found in jax.jit(lambda q: (jax.jacfwd(outputs)(q), jax.jacrev(outputs)(q)))(q):
        np.testing.assert_allclose(found, jnp.stack(numeric, -1), atol=1e-7)


def test_second_derivative_of_the_tank():
    """h = (q / a)^2, so d2h/da2 = 6 q^2 / a^4."""

    def level(a):
        return steady_outputs(tank(), (a, 0.0), {"q": jnp.array([3.0])})["h"][0]

    assert jax.jit(jax.grad(jax.grad(level)))(2.0) == pytest.approx(6 * 9 / 16, rel=1e-9)


def test_stubborn_point_is_followed_in_time():
    """Newton alone runs away on atan from far; three states settle one after the other."""
    v = plant(
        "a b c", "u", "p",
        lambda x, u, p: {
            "a": -jnp.arctan(p["p"] * (x["a"] - u["u"])), "b": -jnp.arctan(x["b"] - x["a"]), "c": x["b"] - x["c"] ** 3,
        },
    )  # fmt: skip
    u = np.array([20.0, -300.0])
    a, b, c = steady_states(v, (u, 0.0), (5.0,), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(a, u, rtol=1e-9)
    np.testing.assert_allclose(b, u, rtol=1e-9)
    np.testing.assert_allclose(c, np.cbrt(u), rtol=1e-9)


def test_points_without_rest_are_nan_and_leave_the_others_alone():
    """x' = u - tanh x rests only for |u| < 1."""
    v = plant("x", "u", "p", lambda x, u, p: {"x": u["u"] - p["p"] * jnp.tanh(x["x"])})
    u = np.array([0.5, 2.0, -0.9])
    x = np.array(steady_states(v, (u, 0.0), (1.0,), (0.0,))[0])
    np.testing.assert_allclose(x[[0, 2]], np.arctanh(u[[0, 2]]), rtol=1e-10)
    assert np.isnan(x[1])
    gradient = jax.jit(jax.grad(lambda p: jnp.sum(steady_states(v, (u[[0, 2]], 0.0), (p,), (0.0,))[0])))(1.0)
    np.testing.assert_allclose(gradient, -np.sum(u[::2] / (1 - u[::2] ** 2)), rtol=1e-8)


def test_free_state_is_nan():
    v = plant("angle w", "u", "p", lambda x, u, p: {"angle": x["w"], "w": u["u"] - p["p"] * x["w"]})
    assert np.all(np.isnan(steady_states(v, (np.ones(2), 0.0), (1.0,), (0.0, 0.0))))


def test_time_and_missing_inputs_are_refused():
    v = plant("x", "u", "p", lambda x, u, p: {"x": u["u"] - x["x"] + jnp.sin(u["t"])})
    with pytest.raises(ModelError, match="never rests"):
        steady_states(v, (0.0, 0.0), (1.0,), (0.0,))
    with pytest.raises(ModelError, match="needs input 'load'"):
        steady_outputs(motor(), MOTOR, {"v": np.ones(3)})
