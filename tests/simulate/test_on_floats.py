"""The rate on floats against the compiled one: library models, equations with every function, and where no number
comes out."""

import sys
from pathlib import Path

import numpy as np
import pytest

import plantfit as pf
from plantfit.models.library.catalogue import make
from plantfit.models.model import Declared, Model
from plantfit.simulate.check import mode_equations, tight
from plantfit.simulate.check.on_floats import plain_rate
from plantfit.simulate.steps.vector import vectorise

sys.path.append(str(Path(__file__).parents[1] / "models"))
from test_model_library import ALL, values

import jax
import jax.numpy as jnp

MOVING = [entry for entry in ALL if not entry[0].endswith("_regression")]
EVERY = """
x' = -k*x + sin(u) + cos(x)*tanh(z) + exp(-x^2) + sqrt(abs(z) + 1) + log(2 + x^2) + atan2(x, u + 3) + asin(0.3*tanh(u))
z' = max(x, u) - min(z, 2)*sign(u) + (x if u > 0.2 and not z > 9 else -z) + abs(x)^1.7 + floor(3*u) + x/(1 + z^2) + tan(0.1*x) + k*t
y = x
"""  # noqa: E501


def own(text):
    states = [line[0] for line in text.splitlines() if line[1] == "'"]
    return pf.equations(text, states=states, outputs=["y"], parameters={"k": {"bounds": (0.1, 1.0)}})


def rates(model, p):
    """Rates by Python and by jax, at channels a + b*t and states up to `size`."""
    vector = vectorise(model)
    numbers = tuple(np.asarray(p[n], dtype=float) for n in vector.parameters)
    made = plain_rate(vector, numbers)
    assert made is not None
    compiled = tight._Smooth(vector, numbers)

    def both(a, b, t, size=1.0):
        x = np.random.default_rng(5).uniform(-size, size, len(vector.states))
        return np.array(made(0.0, a, b)(x, t)), np.asarray(compiled.call(np.concatenate([x, a + b * t])))

    return both


@pytest.mark.parametrize(("name", "options"), MOVING)
def test_library_models_have_the_same_rate(name, options):
    model = make(name, **options)
    assert isinstance(model, Model)
    count = len(vectorise(model).channels)
    both = rates(model, values(model))
    rng = np.random.default_rng(1)
    for size in (0.3, 1.0, 1.0, 3.0, 100.0):  # within tables, and beyond both of their ends
        plain, compiled = both(rng.uniform(-size, size, count), rng.uniform(-1, 1, count), rng.uniform(), size)
        np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-14)


def test_every_function_of_an_equation_is_the_same():
    model = pf.equations(
        EVERY, inputs=["u"], states=["x", "z"], outputs=["y"], parameters={"k": {"bounds": (0.1, 1.0)}}
    )
    rng, both = np.random.default_rng(2), rates(model, {"k": 0.7})
    for _ in range(50):
        plain, compiled = both(rng.uniform(-2, 2, 2), rng.uniform(-2, 2, 2), rng.uniform())
        np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-14)


NO_NUMBER = ["1/x", "sqrt(x)", "log(x)", "exp(900*(1 + x))", "x^0.5", "max(k/x, 1)", "1e308*(10 + x) - 1e308*(11 + x)"]


@pytest.mark.parametrize("rate", NO_NUMBER)
def test_where_no_number_comes_out_it_raises_and_the_solver_asks_jax(rate):
    vector = vectorise(own(f"x' = k*({rate})\ny = x"))
    made = plain_rate(vector, (1.0,))
    assert made is not None
    with pytest.raises((ValueError, ArithmeticError)):
        made(0.0, np.zeros(1), np.zeros(1))(np.array([0.0 if rate in ("1/x", "log(x)", "max(k/x, 1)") else -1e-3]), 0.0)


def test_a_nan_that_a_choice_would_swallow_raises():
    vector = vectorise(own("x' = max(k, x)\nz' = k\ny = x"))
    made = plain_rate(vector, (1.0,))
    assert made is not None
    with pytest.raises(ValueError, match="nan"):
        made(0.0, np.zeros(1), np.zeros(1))(np.array([np.nan, 0.0]), 0.0)


def test_arrays_of_an_own_model_are_lines_of_numbers():
    matrix = np.array([[0.0, 1.0], [-4.0, -0.5]])

    def moved(x, u, p):
        state = jnp.array([x["a"], x["b"]])
        forced = jnp.sum(matrix * state[None, :], axis=1) + p["gain"] * u["u"]
        place = jnp.clip(jnp.floor(2.0 * u["u"]).astype(int), 0, 1)
        bent = jax.lax.dynamic_index_in_dim(p["gain"], place, keepdims=False)
        total = jnp.max(jnp.concatenate([forced, p["gain"][::-1]])) + bent
        return {
            "a": forced[0] + total + p["gain"] @ state,
            "b": (matrix @ state)[1] + jnp.transpose(matrix)[0, 1] * forced[1],
        }

    declared = (Declared("gain", None, (-5.0, 5.0), shape=(2,)),)
    model = Model(
        "own", {"a": None, "b": None}, {"u": None}, {"y": None}, declared, lambda x, u, p: {"y": x["a"]}, moved
    )
    rng = np.random.default_rng(3)
    for _ in range(20):
        plain, compiled = rates(model, {"gain": rng.normal(size=2)})(rng.uniform(-2, 2, 2), np.zeros(2), 0.0)
        np.testing.assert_allclose(plain, compiled, rtol=1e-13)


def test_operations_without_a_form_on_numbers_are_left_to_jax():
    def moved(x, u, p):
        return {"a": jax.lax.fori_loop(0, 3, lambda _, v: 0.5 * v, x["a"])}

    model = Model("own", {"a": None}, {}, {"y": None}, (), lambda x, u, p: {"y": x["a"]}, moved)
    assert plain_rate(vectorise(model), ()) is None


@pytest.mark.parametrize("name", ["steam_chamber", "tabled_first_order"])
def test_a_record_through_tables_is_followed_to_the_same_end(name, monkeypatch):
    model = make(name)
    assert isinstance(model, Model)
    p, t = values(model), np.arange(0.0, 6.0, 0.25)
    level = np.where(np.arange(len(t)) // 6 % 2 == 0, 20.0, 45.0)
    signals = {n: pf.Signal(level) for n in (*model.inputs, *model.outputs)}
    problem = pf.Problem(model, pf.Recording(t, signals), {n: pf.Parameter(value=v) for n, v in p.items()})
    [drive] = problem.data["drive"].values()
    found = tight.follow(problem.predictor.stepping(), p, drive)
    monkeypatch.setattr(tight, "plain_rate", lambda *_: None)
    known = tight.follow(problem.predictor.stepping(), p, drive)
    assert found.stopped is known.stopped is None
    np.testing.assert_allclose(found.states, known.states, rtol=1e-7, atol=1e-9)


STICKS = """
x' = v
v' = (k*u - 3*x - friction(v, 0.7, 1.1))/1.3
z = play(x, gap)
w' = -w
when rising(x - 0.2): w = w + 1
y = z
"""


@pytest.mark.thorough
def test_friction_backlash_and_events_are_followed_to_the_same_end(monkeypatch):
    spoken = {n: {"bounds": (0.01, 9.0)} for n in ("k", "gap")}
    model = pf.equations(STICKS, states=["x", "v", "z", "w"], inputs=["u"], outputs=["y"], parameters=spoken)
    p, t = {"k": 2.0, "gap": 0.05}, np.arange(0.0, 10.0, 0.1)
    signals = {"u": pf.Signal(1.5 * np.sin(0.9 * t)), "y": pf.Signal(0.0 * t)}
    problem = pf.Problem(model, pf.Recording(t, signals), {n: pf.Parameter(value=v) for n, v in p.items()})
    [drive] = problem.data["drive"].values()
    made = mode_equations.mode_equations(vectorise(model))
    assert all(f.plain is not None for f in (made.motion, made.forces, *made.jumps, made.flanks))
    with monkeypatch.context() as patched:
        patched.setattr(mode_equations.ModeFunction, "by_jax", lambda *_: pytest.fail("jax was asked"))
        found = tight.follow(problem.predictor.stepping(), p, drive)
    monkeypatch.setattr(mode_equations, "on_floats", lambda *_: None)
    mode_equations.mode_equations.cache_clear()
    known = tight.follow(problem.predictor.stepping(), p, drive)
    mode_equations.mode_equations.cache_clear()
    assert found.stopped is known.stopped is None
    assert np.any(found.states[3] > 0.5)  # the event came
    np.testing.assert_allclose(found.states, known.states, rtol=1e-8, atol=1e-10)
