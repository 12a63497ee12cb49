"""Bouncing balls, sticking masses and backlash against closed forms and event-based integration by scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulate_events_plants import plant

import plantfit as pf
import plantfit.runtime
from plantfit.errors import ModelError, SimulationError
from plantfit.models.parts.switching import Backlash, Event, Friction
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.steppers import rk4, rosenbrock
from plantfit.simulate.steps.switching import (
    bind_backlash,
    bind_event,
    bind_friction,
    with_backlash,
    with_events,
    with_friction,
)
from plantfit.simulate.steps.switching.switched import Switching

import jax
import jax.numpy as jnp

BALL = plant("y v", "u", "g e", lambda x, u, p: {"y": x["v"], "v": -p["g"] + 0.0 * u["u"]})
BOUNCE = Event("bounce", lambda x, u, p: x["y"], lambda x, u, p: {"v": -p["e"] * x["v"]})


def march(step, vector, x0, inputs, times, p):
    """States at all times; inputs (channels, N) are straight lines between samples."""

    def body(x, row):
        u0, u1, h = row
        x1 = step(vector.rate, x, u0, u1, h, p, True)
        return x1, x1

    channels = tuple(jnp.asarray(u) for u in inputs)
    rows = tuple(u[:-1] for u in channels), tuple(u[1:] for u in channels), jnp.diff(times)
    x0 = tuple(jnp.asarray(v, dtype=float) for v in x0)
    _, later = jax.lax.scan(body, x0, rows)
    return jnp.stack([jnp.concatenate([a[None], b]) for a, b in zip(x0, later, strict=True)])


def bounced(t, height, g, e):
    """Height and velocity of a ball dropped at rest."""
    hit, v = np.sqrt(2 * height / g), np.sqrt(2 * height * g)
    if t < hit:
        return height - 0.5 * g * t * t, -g * t
    while True:
        v, t0 = e * v, hit
        hit = t0 + 2 * v / g
        if t < hit:
            return v * (t - t0) - 0.5 * g * (t - t0) ** 2, v - g * (t - t0)


def ball(q, times, event=BOUNCE, most=2):
    step = with_events(rk4, [bind_event(event, BALL)], most)
    return march(step, BALL, (q[2], 0.0), jnp.zeros((2, len(times))), times, (q[0], q[1]))


@pytest.mark.parametrize(
    "event",
    [
        BOUNCE,
        Event("b", lambda x, u, p: -3.0 * x["y"], BOUNCE.then, "rising"),
        Event("b", BOUNCE.when, BOUNCE.then, "both"),
    ],
)
def test_ball_bounces_at_the_right_times_with_the_right_energy(event):
    times = 0.05 * np.arange(60)
    y, v = jax.jit(lambda q: ball(q, times, event))(jnp.array([9.81, 0.8, 1.0]))
    truth = np.array([bounced(t, 1.0, 9.81, 0.8) for t in times]).T
    np.testing.assert_allclose(y, truth[0], atol=1e-12)
    np.testing.assert_allclose(v, truth[1], atol=1e-11)
    energy = 9.81 * y + 0.5 * v**2
    bounces = np.round(np.log(np.asarray(energy) / 9.81) / np.log(0.64))
    np.testing.assert_allclose(energy, 9.81 * 0.64**bounces, rtol=1e-10)
    assert bounces[0] == 0
    assert bounces[-1] >= 4


@pytest.mark.thorough
def test_derivatives_of_the_ball_carry_the_times_of_impact():
    times, q = 0.05 * np.arange(30), np.array([9.81, 0.8, 1.0])
    got = jax.jit(jax.jacrev(lambda q: ball(q, times)))(q)
    for k in range(3):
        d = 1e-6 * np.eye(3)[k]
        truth = [(np.array(bounced(t, *(q + d)[[2, 0, 1]])) - bounced(t, *(q - d)[[2, 0, 1]])) / 2e-6 for t in times]
        np.testing.assert_allclose(got[..., k], np.array(truth).T, atol=1e-7)


@pytest.mark.parametrize(("rate", "level"), [(1.0, lambda x, a: x - a), (2.0, lambda x, a: jnp.sin(x / 9.0) - a / 9.0)])
def test_a_crossing_that_changes_nothing_about_its_surface_happens_once(rate, level):
    """Rounding must not leave the state before the surface, to pass it again: 3 of 100 moments were counted twice."""
    v = plant("x c", "u", "a", lambda x, u, p: {"x": rate + 0.0 * x["x"], "c": 0.0 * x["x"]})
    event = Event("up", lambda x, u, p: level(x["x"], p["a"]), lambda x, u, p: {"c": x["c"] + 1.0}, "rising")
    step, grid = with_events(rk4, [bind_event(event, v)]), 0.13 * np.arange(28)

    def count(a):
        return march(step, v, (0.0, 0.0), jnp.zeros((2, len(grid))), grid, (a,))[1, -1]

    np.testing.assert_array_equal(jax.jit(jax.vmap(count))(jnp.linspace(0.2, 2.9, 300)), 1.0)


@pytest.mark.thorough
def test_a_step_that_would_pass_the_surface_leaves_no_nan_in_derivatives():
    """A tank that is filled again when nearly empty; the slope of the square root below zero is NaN, and no step
    that counts goes there."""
    v = plant("h", "u", "a", lambda x, u, p: {"h": -p["a"] * jnp.sqrt(jnp.maximum(x["h"], 0.0))})
    event = Event("fill", lambda x, u, p: x["h"] - 4e-4, lambda x, u, p: {"h": 1.0})
    step, times = with_events(rk4, [bind_event(event, v)]), 0.02 * np.arange(120)

    def level(a):
        return march(step, v, (1.0,), jnp.zeros((2, len(times))), times, (a,))[0]

    def exact(a, t=times):
        empty = 2.0 * 0.98 / a
        return (1.0 - 0.5 * a * np.mod(t, empty)) ** 2

    rates = jnp.array([1.53, 1.97, 2.21])
    slopes = jax.jit(jax.vmap(jax.jacrev(level)))(rates)
    for k, a in enumerate(np.asarray(rates)):
        # the square root is no place for steps of order 4
        np.testing.assert_allclose(slopes[k], (exact(a + 1e-6) - exact(a - 1e-6)) / 2e-6, atol=0.02)


def test_impact_exactly_on_a_sample():
    """g = 2, height 1: the ball lands at t = 1 exactly and is then known from both sides."""
    whole = lambda q: ball(q, 0.25 * np.arange(9))  # noqa: E731
    (y, _), slopes = jax.jit(lambda q: (whole(q), jax.jacfwd(whole)(q)))(jnp.array([2.0, 0.5, 1.0]))
    np.testing.assert_allclose(y[4:8], [bounced(t, 1.0, 2.0, 0.5)[0] for t in (1.0, 1.25, 1.5, 1.75)], atol=1e-12)
    d = 1e-6  # dropped lower, at t = 1.5
    assert slopes[0, 6, 2] == pytest.approx(
        (bounced(1.5, 1 + d, 2.0, 0.5)[0] - bounced(1.5, 1 - d, 2.0, 0.5)[0]) / (2 * d), rel=1e-6
    )


def test_too_many_events_are_nan_and_not_a_ball_below_the_floor():
    y, _ = jax.jit(lambda q: ball(q, np.array([0.0, 0.4, 3.0])))(jnp.array([9.81, 0.3, 1.0]))
    assert np.isfinite(y[1])
    assert np.isnan(y[2])


def test_first_of_two_events_comes_first():
    """A mass between two walls, hit twice in one step, in either order of declaration."""
    v = plant("y v", "u", "p", lambda x, u, p: {"y": x["v"], "v": 0.0 * x["y"]})

    def turn(x, u, p):
        return {"v": -x["v"]}

    walls = [Event("left", lambda x, u, p: x["y"], turn), Event("right", lambda x, u, p: x["y"] - 1.0, turn, "rising")]
    for order in (walls, walls[::-1]):
        step = with_events(rk4, [bind_event(e, v) for e in order], 2)
        got = jax.jit(lambda s, step=step: step(v.rate, (0.5, 1.0), (0.0, 0.0), (0.0, 0.0), s, (1.0,), False))(1.75)
        np.testing.assert_allclose(got, (0.25, 1.0), atol=1e-12)


def test_unknown_names_are_refused():
    with pytest.raises(ModelError, match="direction 'up'"):
        bind_event(Event("b", BOUNCE.when, BOUNCE.then, "up"), BALL)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ModelError, match="names 'w'"):
        bind_event(Event("b", BOUNCE.when, lambda x, u, p: {"w": 0.0}), BALL).then((1.0, 1.0), (0.0, 0.0), (1.0, 1.0))
    with pytest.raises(ModelError, match="acts on 'w'"):
        bind_backlash(Backlash("w", BOUNCE.when, BOUNCE.when), BALL)


MASS = plant("s v", "F", "m Fc Fs", lambda x, u, p: {"s": x["v"], "v": u["F"] / p["m"]})
DRY = Friction("v", lambda x, u, p: p["Fc"], lambda x, u, p: p["Fs"], lambda x, u, p: {"v": 1.0 / p["m"]})
SAMPLES = np.linspace(0.0, 3.0, 301)
FORCE = 1.4 * np.interp(SAMPLES, np.linspace(0, 3, 31), np.sin(4 * np.linspace(0, 3, 31)))


def rubbing(q, stepper=rk4, force=FORCE, times=SAMPLES):
    step = with_friction(stepper, bind_friction(DRY, MASS))
    return march(step, MASS, (0.0, 0.0), (force, np.zeros_like(force)), times, (q[0], q[1], q[2]))


def one_mode(force, m, fc, fs, mode):
    """Rates of a mass that slides up (1), down (-1) or sticks (0), and the event that ends it."""

    def rates(s, z):
        return [z[1], (force(s) - mode * fc) / m] if mode else [0.0, 0.0]

    def ends(s, z):
        return mode * z[1] if mode else fs - abs(force(s))

    ends.terminal, ends.direction = True, -1  # pyrefly: ignore[missing-attribute]
    return rates, ends


def rubbing_by_scipy(m, fc, fs):
    """Mode by mode with events at 1e-12."""

    def force(t):
        return np.interp(t, SAMPLES, FORCE)

    t, x, mode, states = 0.0, np.zeros(2), 0, {0.0: np.zeros(2)}
    corners = np.linspace(0, 3, 31)
    while t < 3.0 - 1e-12:
        if mode == 0 and abs(force(t)) > fs * (1 + 1e-12):
            mode = int(np.sign(force(t)))

        end = corners[np.searchsorted(corners, t + 1e-11)]
        rates, ends = one_mode(force, m, fc, fs, mode)
        run = solve_ivp(rates, (t, end), x, "DOP853", events=ends, rtol=1e-11, atol=1e-13, dense_output=True)
        states |= {round(s, 9): run.sol(s) for s in SAMPLES if t < s <= run.t[-1] + 1e-12}
        t, x = run.t[-1], run.y[:, -1].copy()
        if run.status == 1 and mode:
            x[1], mode = 0.0, 0
        elif run.status == 1:
            mode = int(np.sign(force(t)))
    return np.array([states.get(round(s, 9), [np.nan] * 2) for s in SAMPLES]).T


@pytest.mark.parametrize(("fc", "fs"), [(0.7, 1.1), (1.0, 1.0), (0.2, 0.2)])
def test_rubbing_mass_against_event_based_integration(fc, fs):
    s, v = jax.jit(rubbing)(jnp.array([0.5, fc, fs]))
    truth = rubbing_by_scipy(0.5, fc, fs)
    np.testing.assert_allclose(s, truth[0], atol=1e-8)
    np.testing.assert_allclose(v, truth[1], atol=1e-8)
    stuck = truth[1] == 0.0
    assert np.all(np.array(v)[stuck] == 0.0)
    assert np.sum(stuck) > (30 if fs > 0.5 else 0)


def test_a_force_below_breakaway_never_moves_the_mass():
    s, v = jax.jit(lambda q: rubbing(q, rosenbrock))(jnp.array([0.5, 0.7, 2.01]))
    assert np.all(np.array(s) == 0.0)
    assert np.all(np.array(v) == 0.0)


@pytest.mark.thorough
def test_mass_slides_on_for_its_momentum_and_stops():
    """v0 = 1: stops after m v0 / Fc at m v0^2 / (2 Fc), inside a step."""
    step = with_friction(rk4, bind_friction(DRY, MASS))

    def run(q):
        return jnp.stack(step(MASS.rate, (0.0, q[2]), (0.0, 0.0), (0.0, 0.0), 1.0, (q[0], q[1], q[1]), False))

    end, slopes = jax.jit(lambda q: (run(q), jax.jacrev(run)(q)))(jnp.array([0.5, 0.7, 1.0]))
    np.testing.assert_allclose(end, [0.5 / 1.4, 0.0], atol=1e-14)
    np.testing.assert_allclose(slopes[0], [1 / 1.4, -0.5 / (2 * 0.49), 0.5 / 0.7], rtol=1e-9)
    np.testing.assert_allclose(slopes[1], 0.0, atol=1e-12)


def test_derivatives_of_the_rubbing_mass():
    """Against differences of the reference: the times of sticking and breaking away move."""
    q = np.array([0.5, 0.7, 1.1])
    got = jax.jit(jax.jacfwd(lambda q: rubbing(q)[:, ::50]))(q)
    for k in range(3):
        d = 1e-4 * np.eye(3)[k]
        numeric = (rubbing_by_scipy(*(q + d)) - rubbing_by_scipy(*(q - d)))[:, ::50] / 2e-4
        np.testing.assert_allclose(got[..., k], numeric, atol=2e-3 * max(1.0, np.max(np.abs(numeric))))


def test_batch_of_masses_agrees_with_single_ones():
    q = jnp.array([[0.5, 0.7, 1.1], [0.5, 1.0, 1.0]])
    np.testing.assert_allclose(jax.jit(jax.vmap(rubbing))(q)[0], jax.jit(rubbing)(q[0]), atol=1e-13)


def test_backlash_is_the_play_operator():
    """The drive is an integrator; the driven side follows min(max(y, x - b), x + b) and drives a third state."""
    v = plant("x y z", "u", "b", lambda x, u, p: {"x": u["u"], "y": 0.0, "z": x["y"]})
    lash = Backlash("y", lambda x, u, p: x["x"], lambda x, u, p: p["b"])
    times = 0.1 * np.arange(80)
    u = np.repeat([1.0, -1.0, 1.0, -1.0], 20)  # turns within one sample interval
    step = with_backlash(rk4, bind_backlash(lash, v))

    def run(b):
        return march(step, v, (0.0, 0.0, 0.0), (u, np.zeros_like(u)), times, (b,))

    x, y, z = jax.jit(run)(0.3)
    expected = [0.0]
    for k in range(1, len(times)):
        expected.append(min(max(expected[-1], float(x[k]) - 0.3), float(x[k]) + 0.3))
    np.testing.assert_allclose(y, expected, atol=1e-12)
    assert float(jnp.max(y) - jnp.min(y)) == pytest.approx(float(jnp.max(x) - jnp.min(x)) - 0.6, abs=0.31)
    np.testing.assert_allclose(z, np.r_[0, np.cumsum(0.05 * (y[1:] + y[:-1]))], atol=0.02)
    np.testing.assert_allclose(jax.jit(jax.jacrev(lambda b: run(b)[1]))(0.3)[15], -1.0)


def test_a_play_may_drive_another_one():
    """w follows y, which follows x; the mass z between them is driven by both, so that its rate sees them move."""
    v = plant("w x y z", "u", "a b", lambda x, u, p: {"w": 0.0, "x": u["u"], "y": 0.0, "z": x["w"] + x["y"]})
    plays = [
        Backlash("y", lambda x, u, p: x["x"], lambda x, u, p: p["a"]),
        Backlash("w", lambda x, u, p: x["y"], lambda x, u, p: p["b"]),
    ]
    times, u = 0.1 * np.arange(80), np.repeat([1.0, -1.0, 1.0, -1.0], 20)
    gaps = 0.3, 0.2

    def run(*p):
        return march(with_backlash(rk4, *(bind_backlash(b, v) for b in plays)), v, (0.0,) * 4, (u, 0.0 * u), times, p)

    w, x, y, z = np.array(jax.jit(run)(*gaps))
    for driven, drive, gap in ((y, x, 0.3), (w, y, 0.2)):
        expected = [0.0]
        for d in drive[1:]:
            expected.append(min(max(expected[-1], d - gap), d + gap))
        np.testing.assert_allclose(driven, expected, atol=1e-12)
    assert np.ptp(w) > 0.5
    np.testing.assert_allclose(z, np.r_[0, np.cumsum(0.05 * (w[1:] + w[:-1] + y[1:] + y[:-1]))], atol=0.02)
    # both gaps hold w back alike where it is pushed
    np.testing.assert_allclose(np.array(jax.jit(jax.jacrev(lambda *p: run(*p)[0], (0, 1)))(*gaps))[:, 15], -1.0)


@pytest.mark.thorough
def test_a_step_is_traced_once_wherever_it_stands():
    """Friction inside of events: a step is asked for at both, to look, to search, to go on, and with derivatives."""
    v = plant("x v", "F", "m Fc", lambda x, u, p: {"x": x["v"], "v": u["F"] / p["m"]})
    dry = Friction("v", lambda x, u, p: p["Fc"], lambda x, u, p: p["Fc"], lambda x, u, p: {"v": 1.0 / p["m"]})
    wall = Event("wall", lambda x, u, p: x["x"] + 1.0, lambda x, u, p: {"v": -0.5 * x["v"]})
    calls = []

    def counted(*given):
        calls.append(1)
        return rk4(*given)

    step = with_events(with_friction(counted, bind_friction(dry, v)), [bind_event(wall, v)])
    x, u, p = (jnp.array(0.5), jnp.array(-1.0)), (jnp.array(0.2), jnp.array(0.0)), (jnp.array(1.3), jnp.array(0.1))
    jax.make_jaxpr(lambda x, p: jax.vjp(lambda x, p: step(v.rate, x, u, u, 0.01, p, True), x, p)[1]((1.0, 1.0)))(x, p)
    assert len(calls) <= 2


def test_a_place_is_searched_once_where_derivatives_are_taken():
    """Backwards, the segments of a step are followed once more, with the places that were found."""
    v = plant("x v", "F", "m Fc", lambda x, u, p: {"x": x["v"], "v": u["F"] / p["m"]})
    dry = Friction("v", lambda x, u, p: p["Fc"], lambda x, u, p: p["Fc"], lambda x, u, p: {"v": 1.0 / p["m"]})
    wall = Event("wall", lambda x, u, p: x["x"] + 1.0, lambda x, u, p: {"v": -0.5 * x["v"]})
    x, u, p = (jnp.array(0.5), jnp.array(-1.0)), (jnp.array(0.2), jnp.array(0.0)), (jnp.array(1.3), jnp.array(0.1))
    for step in (with_events(rk4, [bind_event(wall, v)]), with_friction(rk4, bind_friction(dry, v))):
        assert isinstance(step, Switching)

        def pulled(x, p, whole=step.whole):
            return jax.vjp(lambda x, p: whole(v.rate, x, u, u, 0.01, p, True), x, p)[1]((1.0, 1.0))

        assert str(jax.make_jaxpr(pulled)(x, p)).count("while[") == 1


def test_a_matrix_exponential_is_refused_where_it_would_leave_friction_out():
    text = "v' = (F - friction(v, Fc))/m\ny = v"
    model = pf.equations(text, inputs=["F"], states=["v"], outputs=["y"], parameters=["Fc", "m"], check=False)
    with pytest.raises(
        SimulationError,
        match="dry friction or backlash, which no matrix exponential follows; use stepper = 'exponential'",
    ):
        Simulator.of(model, stepper="exact")
