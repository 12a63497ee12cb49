"""State delays against closed forms of the method of steps, scipy, and central differences of these."""

from itertools import pairwise
from math import factorial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.steps.history import Lag, delayed_rollout, history_grid, ring_length, substeps_below
from plantfit.simulate.steps.registry import FIXED, STEPPERS

import jax
import jax.numpy as jnp

T = 0.1 * np.arange(41)
LOW, HIGH = 0.3, 1.2


def closed_form(t, tau):
    """x' = -x(t - tau), x = 1 until 0: sum over k of (-1)^k (t - (k - 1) tau)^k / k! (R. D. Driver 1977, p. 227)."""
    return (
        sum(
            np.where(t >= (k - 1) * tau, (-1) ** k * np.maximum(t - (k - 1) * tau, 0.0) ** k / factorial(k), 0.0)
            for k in range(1, 20)
        )
        + 1
    )


def pure(tau, t=T, substeps=1, stepper="rk4", bounds=(LOW, HIGH)):
    """x' = -x(t - tau) at the samples."""
    jumps = np.zeros(0)
    grid = history_grid(t, substeps, jumps, [tau])
    u = (jnp.zeros(grid.sample.shape),)
    slots = ring_length(t, substeps, jumps, [bounds[1]])
    x = delayed_rollout(
        STEPPERS[stepper].step, lambda x, u, p: (-u[0],), (1.0,), u, u, (), grid.times, [Lag(0, 0, tau)], slots
    )
    return x[0][grid.rank]


any_delay = jax.jit(lambda d: pure(d, bounds=(0.1, 4.0)))


@pytest.mark.parametrize("tau", [LOW, 0.5, 0.537, HIGH, 0.1, 3.99])
def test_pure_delay_against_its_polynomials(tau):
    """Also a delay of one step, of the whole record, on samples and off."""
    np.testing.assert_allclose(any_delay(tau), closed_form(T, tau), atol=2e-6)


@pytest.mark.parametrize("stepper", FIXED)
@pytest.mark.further(1)
def test_error_falls_with_the_order_of_the_stepper(stepper):
    order = STEPPERS[stepper].order
    errors = [
        np.max(np.abs(jax.jit(lambda d, n=n: pure(d, substeps=n, stepper=stepper))(0.437) - closed_form(T, 0.437)))
        for n in (1, 2)
    ]
    assert errors[1] < errors[0] / 2.0 ** (order - 0.6)
    assert errors[1] < 10.0 ** (1 - 2 * order)


@pytest.mark.parametrize(
    "stepper", [s if s == "exponential" else pytest.param(s, marks=pytest.mark.slow) for s in FIXED]
)
@pytest.mark.thorough
def test_cost_by_delay_on_the_grid_off_it_and_at_bounds(stepper):
    """Within 1 % at one step per sample, 0.1 % after two halvings, on the gradient's own scale."""
    data = closed_form(T, 0.6) + 0.1 * np.cos(5 * T)

    def tight(tau):
        return np.mean((closed_form(T, tau) - data) ** 2)

    delays = np.array([LOW, 0.437, 0.5, 0.7, HIGH])
    truth = np.array([(tight(d + 1e-6) - tight(d - 1e-6)) / 2e-6 for d in delays])
    for substeps, share in ((1, 0.01), (4, 0.001)):
        gradient = jax.grad(lambda d, n=substeps: jnp.mean((pure(d, substeps=n, stepper=stepper) - data) ** 2))
        got = jax.jit(lambda ds, g=gradient: jax.lax.map(g, ds))(delays)
        assert np.max(np.abs(got - truth)) < share * np.max(np.abs(truth))


@pytest.mark.thorough
def test_reverse_agrees_with_forward_and_batches_with_single():
    weights = np.random.default_rng(0).normal(size=(3, len(T)))

    @jax.jit
    def both(d):
        pulled = jax.vjp(pure, d)[1]
        return jax.vmap(lambda w: pulled(w)[0])(weights), jax.jvp(pure, (d,), (1.0,))[1]

    reverse, forward = both(0.537)
    np.testing.assert_allclose(reverse, weights @ forward, atol=1e-12)
    delays = jnp.array([0.31, 0.537])
    np.testing.assert_allclose(jax.jit(jax.vmap(pure))(delays)[1], any_delay(0.537), atol=1e-14)


def oscillator(q, t, u, substeps=5):
    """v' = -w^2 s - g v(t - tau) + u held, s' = v; q = (w, g, tau, s0)."""
    jumps = t[np.flatnonzero(np.diff(u, prepend=u[0]))]
    grid = history_grid(t, substeps, jumps, [q[2]])
    held = jnp.asarray(u)[grid.sample]
    channels = held, jnp.zeros_like(held)
    slots = ring_length(t, substeps, jumps, [0.6])
    x = delayed_rollout(
        STEPPERS["rk4"].step, lambda x, u, p: (x[1], u[0] - p[0] ** 2 * x[0] - p[1] * u[1]),
        (q[3], 0.0), channels, channels, (q[0], q[1]), grid.times, [Lag(1, 1, q[2])], slots,
    )  # fmt: skip
    return x[0][grid.rank]


def tight_oscillator(q, t, u):
    """The same by scipy, piece by piece between samples and echoes of samples."""
    w, g, tau, s0 = (float(v) for v in q)
    stops = np.unique(np.round(np.concatenate([t, t + tau, t + 2 * tau]), 13))
    stops = stops[stops <= t[-1] + 1e-12]
    pieces, x, at = [], np.array([s0, 0.0]), {0.0: s0}

    def past(time):
        if time <= 0:
            return 0.0
        for a, b, dense in reversed(pieces):
            if a <= time <= b + 1e-12:
                return dense(time)[1]
        raise AssertionError(time)

    for a, b in pairwise(stops):
        held = u[min(np.searchsorted(t, 0.5 * (a + b)) - 1, len(u) - 1)]

        def rate(s, z, held=held):
            return [z[1], held - w * w * z[0] - g * past(s - tau)]

        run = solve_ivp(rate, (a, b), x, "DOP853", rtol=1e-10, atol=1e-12, dense_output=True)
        pieces.append((a, b, run.sol))
        x = run.y[:, -1]
        at[round(b, 12)] = x[0]
    return np.array([at[round(s, 12)] for s in t])


@pytest.mark.thorough
def test_held_inputs_and_irregular_samples_against_scipy():
    rng = np.random.default_rng(4)
    t = np.round(np.r_[0.0, np.cumsum(rng.uniform(0.1, 0.3, 11))], 6)
    u = np.repeat(rng.uniform(-2, 2, 4), 3)
    q = np.array([3.0, 0.8, 0.37, 0.5])
    both = jax.jit(lambda q: (oscillator(q, t, u), jax.jacrev(lambda q: oscillator(q, t, u))(q)))
    states, slopes = both(q)
    np.testing.assert_allclose(states, tight_oscillator(q, t, u), atol=2e-5)
    for k in range(4):
        step = np.eye(4)[k] * 1e-4
        numeric = (tight_oscillator(q + step, t, u) - tight_oscillator(q - step, t, u)) / 2e-4
        np.testing.assert_allclose(slopes[:, k], numeric, atol=1e-3 * np.max(np.abs(numeric)))


def test_steps_longer_than_the_delay_are_never_silent():
    assert np.isnan(any_delay(0.05)[-1])
    assert substeps_below(T, 0.05) == 2
    assert substeps_below(T, 0.1) == 1
    np.testing.assert_allclose(jax.jit(lambda d: pure(d, substeps=2))(0.05), closed_form(T, 0.05), atol=1e-3)
    with pytest.raises(SimulationError, match="raise its lower bound above 0 s"):
        substeps_below(T, 0.0)


def test_delay_beyond_the_ring_is_nan():
    assert np.isnan(jax.jit(lambda d: pure(d, bounds=(0.1, 0.3)))(2.0)[-1])
