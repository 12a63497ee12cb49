"""What the text declares moves as closed forms say: a bouncing ball, a mass that comes to rest, a play."""

import numpy as np
import pytest

from plantfit.models import Model, equations
from plantfit.simulate.steps.steppers import rk4
from plantfit.simulate.steps.switching import (
    bind_backlash,
    bind_event,
    bind_friction,
    with_backlash,
    with_events,
    with_friction,
)
from plantfit.simulate.steps.vector import vectorise

import jax
import jax.numpy as jnp


def states(model: Model, x0, p, times, inputs=()):
    """States (n, N) of a model at times (N,), with all that it declares; inputs are straight lines between times."""
    vector = vectorise(model)
    step = with_backlash(rk4, *(bind_backlash(play, vector) for play in model.backlashes))
    for friction in model.frictions:
        step = with_friction(step, bind_friction(friction, vector))
    step = with_events(step, [bind_event(e, vector) for e in model.events])
    channels = (*(jnp.asarray(u) for u in inputs), jnp.asarray(times))
    values = tuple(jnp.asarray(p[n], dtype=float) for n in vector.parameters)

    def body(x, row):
        u0, u1, h = row
        x = step(vector.rate, x, u0, u1, h, values, True)
        return x, x

    rows = tuple(u[:-1] for u in channels), tuple(u[1:] for u in channels), jnp.diff(channels[-1])
    start = tuple(jnp.asarray(v, dtype=float) for v in x0)
    later = jax.lax.scan(body, start, rows)[1]
    return jnp.stack([jnp.concatenate([a[None], b]) for a, b in zip(start, later, strict=True)])


@pytest.mark.thorough
def test_a_ball_in_text_bounces_in_time():
    ball = equations(
        "h' = v; v' = -g; when falling(h): v = -c*v", states=["h", "v"], outputs=["h"], parameters=["g", "c"]
    )
    times, g, c = np.linspace(0.0, 1.0, 21), 9.81, 0.7
    height = lambda c: states(ball, (1.0, 0.0), {"g": g, "c": c}, times)[0]  # noqa: E731
    h, slopes = jax.jit(lambda c: (height(c), jax.jacfwd(height)(c)))(c)
    first = np.sqrt(2.0 / g)
    up = c * g * first
    after = times > first
    assert times[-1] < first + 2 * up / g  # one bounce
    expected = np.where(after, up * (times - first) - 0.5 * g * (times - first) ** 2, 1.0 - 0.5 * g * times**2)
    np.testing.assert_allclose(h, expected, atol=1e-10)
    assert float(slopes[-1]) == pytest.approx(g * first * (times[-1] - first), rel=1e-8)


@pytest.mark.parametrize(
    "text", ["v' = (-friction(v, R))/m", "f = friction(v, R); v' = -f/m", "v' = friction(v, R)/m*(-1)"]
)
@pytest.mark.thorough
def test_a_mass_in_text_slides_to_rest_and_stays(text):
    mass = equations(f"x' = v; {text}", states=["x", "v"], outputs=["x"], parameters=["R", "m"])
    times, m, v0, force = np.linspace(0.0, 2.0, 11), 2.0, 1.5, 3.0

    def end(r):
        whole = states(mass, (0.0, v0), {"R": r, "m": m}, times)
        return whole[0, -1], whole

    (_, (x, v)), slope = jax.jit(jax.value_and_grad(end, has_aux=True))(force)
    rest = m * v0 / force
    moving = times < rest
    np.testing.assert_allclose(v, np.where(moving, v0 - force / m * times, 0.0), atol=1e-12)
    assert np.all(np.asarray(v)[~moving] == 0.0)
    assert float(x[-1]) == pytest.approx(0.5 * m * v0**2 / force, rel=1e-12)
    assert float(slope) == pytest.approx(-0.5 * m * v0**2 / force**2, rel=1e-8)


def test_a_play_in_text_is_the_play_operator():
    model = equations(
        "w' = a*u; z = play(2*w, gap); y = z", inputs=["u"], states=["w", "z"], outputs=["y"], parameters=["a", "gap"]
    )
    times = np.linspace(0.0, 6.0, 241)
    w, z = states(model, (0.0, 0.0), {"a": 1.0, "gap": 0.3}, times, [np.cos(times)])
    expected, last = [], 0.0
    for drive in 2 * np.asarray(w):
        last = min(max(last, drive - 0.3), drive + 0.3)
        expected.append(last)
    np.testing.assert_allclose(z, expected, atol=1e-12)
    np.testing.assert_allclose(w, np.sin(times), atol=1e-4)


def test_the_study_file_page_shows_a_model_that_works():
    text = """
    x' = v
    v' = (F - friction(v, Fc, Fs))/m
    z = play(delay(F, L)/k, gap)
    when falling(x): v = -c*v, x = 0
    y = x + z
    """
    names = ["Fc", "Fs", "m", "L", "k", "gap", "c"]
    model = equations(text, inputs=["F"], states=["x", "v", "z"], outputs=["y"], parameters=names)
    assert (len(model.events), len(model.frictions), len(model.backlashes), len(model.delays)) == (1, 1, 1, 1)
