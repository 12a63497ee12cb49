"""Exact steps against scipy's discretisation, closed forms and finite differences."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete
from simulate_events_plants import MOTOR, motor, plant, tank

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.linear import advance, exact_maps, exact_step, is_linear

import jax
import jax.numpy as jnp

maps_of = jax.jit(exact_maps, static_argnums=(0, 3))


def stepped(vector, p, h, varying, x, u0, u1):
    return jax.jit(lambda p, h: jnp.stack(exact_step(vector, p, h, varying)(x, u0, u1)))(p, h)


def motor_matrices():
    r, inductance, k, j, b = MOTOR
    a = np.array([[-r / inductance, -k / inductance], [k / j, -b / j]])
    return a, np.array([[1 / inductance, 0], [0, -1 / j]])


def test_which_models_are_linear():
    assert is_linear(motor())
    assert not is_linear(tank())
    assert is_linear(plant("x", "u", "p", lambda x, u, p: {"x": p["p"] ** 2 * u["u"] - x["x"] + jnp.exp(p["p"])}))
    assert not is_linear(plant("x", "u", "p", lambda x, u, p: {"x": u["u"] * x["x"]}))
    assert not is_linear(plant("x", "u", "p", lambda x, u, p: {"x": jnp.clip(u["u"], -1, 1) - x["x"]}))
    assert not is_linear(plant("x", "u", "p", lambda x, u, p: {"x": -u["t"] * x["x"]}))
    assert is_linear(plant("x", "u", "p", lambda x, u, p: {"x": u["t"] - x["x"]}))


@pytest.mark.parametrize("h", [1e-5, 1e-2, 1.0])
@pytest.mark.parametrize(("varying", "method"), [(False, "zoh"), (True, "foh")])
def test_motor_matrices_against_scipy(h, varying, method):
    a, b = motor_matrices()
    maps = maps_of(motor(), MOTOR, h, varying)
    ad, bd, _, d = (np.asarray(m) for m in cont2discrete((a, b, np.eye(2), np.zeros((2, 2))), h, method)[:4])
    np.testing.assert_allclose(maps.state, ad, atol=1e-12)
    np.testing.assert_allclose(maps.constant, 0.0, atol=1e-14)
    if varying:  # scipy moves the state by the input at the end: x = z + d u
        np.testing.assert_allclose(maps.end[:, :2], d, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(maps.start[:, :2], bd - ad @ d, rtol=1e-8, atol=1e-9)
    else:
        np.testing.assert_allclose(maps.start[:, :2], bd, rtol=1e-9, atol=1e-12)


def test_a_ramp_with_a_constant_is_followed_exactly():
    """Units of the input do not matter: the same plant fed in volts and in microvolts."""
    for unit in (1.0, 1e6):
        v = plant(
            "x y", "u", "T c", lambda x, u, p, unit=unit: {"x": (u["u"] / unit - x["x"]) / p["T"] + p["c"], "y": x["x"]}
        )
        got = stepped(v, (0.3, 2.0), 0.7, True, (1.0, -1.0), (0.5 * unit, 0.0), (3.0 * unit, 0.7))
        truth = solve_ivp(
            lambda t, z: [(0.5 + 2.5 * t / 0.7 - z[0]) / 0.3 + 2.0, z[0]],
            (0, 0.7),
            [1.0, -1.0],
            rtol=1e-11,
            atol=1e-12,
            method="DOP853",
        ).y[:, -1]
        np.testing.assert_allclose(got, truth, rtol=1e-9)


def test_steps_join_and_zero_length_changes_nothing():
    x, u = (0.3, -20.0), (5.0, 0.01, 0.0)
    half, whole = maps_of(motor(), MOTOR, 0.02, False), maps_of(motor(), MOTOR, 0.04, False)
    np.testing.assert_allclose(advance(half, advance(half, x, u, u), u, u), advance(whole, x, u, u), rtol=1e-12)
    np.testing.assert_allclose(advance(maps_of(motor(), MOTOR, 0.0, True), x, u, u), x, rtol=1e-15)


def test_very_stiff_blocks_settle():
    v = plant("x", "u", "T", lambda x, u, p: {"x": (u["u"] - x["x"]) / p["T"]})
    u = (2.0, 0.0)
    for constant, share in ((1e-3, 1e-12), (1e-6, 1e-9), (1e-12, 1e-3)):
        assert advance(maps_of(v, (constant,), 1.0, False), (7.0,), u, u)[0] == pytest.approx(2.0, rel=share)


@pytest.mark.parametrize(("transform", "varying"), [(jax.jacfwd, False), (jax.jacrev, True)])
@pytest.mark.further(1)
def test_derivatives_by_parameters_and_length(transform, varying):
    @jax.jit
    def end(q):
        step = exact_step(motor(), tuple(q[:5] * jnp.array(MOTOR)), 0.01 * q[5], varying)
        return jnp.stack(step((0.3, -20.0 * q[6]), (5.0, 0.01, 0.0), (6.0, 0.0, 0.0)))

    q, step = jnp.ones(7), 1e-6
    numeric = [(end(q.at[k].add(step)) - end(q.at[k].add(-step))) / (2 * step) for k in range(7)]
    np.testing.assert_allclose(jax.jit(transform(end))(q), jnp.stack(numeric, -1), rtol=1e-6, atol=1e-7)


def test_derivative_at_zero_length_is_the_rate():
    x, u = (0.3, -20.0), (5.0, 0.01, 0.0)
    slope = jax.jit(jax.jacrev(lambda h: jnp.stack(exact_step(motor(), MOTOR, h, True)(x, u, u))))(0.0)
    np.testing.assert_allclose(slope, jnp.stack(motor().rate(x, u, MOTOR)), rtol=1e-12)


def test_maps_for_many_lengths_and_candidates():
    lengths = jnp.array([0.0, 0.01, 0.3])
    maps = maps_of(motor(), MOTOR, lengths, True)
    x, u0, u1 = (0.3, -20.0), (5.0, 0.01, 0.0), (6.0, 0.02, 0.0)
    together = jax.vmap(lambda m: jnp.stack(advance(m, x, u0, u1)))(maps)
    alone = [jnp.stack(advance(maps_of(motor(), MOTOR, float(h), True), x, u0, u1)) for h in lengths]
    np.testing.assert_allclose(together, jnp.stack(alone), rtol=1e-12)
    batch = jax.jit(jax.vmap(lambda r: jnp.stack(exact_step(motor(), (r, *MOTOR[1:]), 0.01, True)(x, u0, u1))))(
        jnp.array([1.0, MOTOR[0]])
    )
    np.testing.assert_allclose(batch[1], alone[1], rtol=1e-12)
