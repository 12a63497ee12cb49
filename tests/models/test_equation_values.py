"""Values of expressions against numpy, and of whole models against functions written by hand."""

import re
from typing import Any

import numpy as np
import pytest
from model_calls import derivative, initial_state

from plantfit.models import dc_motor, equations, first_order, second_order
from plantfit.models.text.functions import CALLS

import jax

RNG_SEED = 5

EXPRESSIONS = {
    "a + b*c - a/b": lambda a, b, c: a + b * c - a / b,
    "-a^2": lambda a, b, c: -(a**2),
    "2^-b": lambda a, b, c: 2.0 ** (-b),
    "a ** b ^ 0.5": lambda a, b, c: a ** (b**0.5),
    "a^3 + a^-2 + a^0 + a^0.5": lambda a, b, c: a**3 + a**-2.0 + 1 + np.sqrt(a),
    "sin(a) + cos(b) + tan(c/4)": lambda a, b, c: np.sin(a) + np.cos(b) + np.tan(c / 4),
    "asin(a/9) + acos(b/9)": lambda a, b, c: np.arcsin(a / 9) + np.arccos(b / 9),
    "atan(c) + atan2(a, -b)": lambda a, b, c: np.arctan(c) + np.arctan2(a, -b),
    "sinh(a) + cosh(b) + tanh(c)": lambda a, b, c: np.sinh(a) + np.cosh(b) + np.tanh(c),
    "exp(-a) + log(b) + log10(c) + sqrt(a)": lambda a, b, c: np.exp(-a) + np.log(b) + np.log10(c) + np.sqrt(a),
    "abs(a - b) * sign(b - c)": lambda a, b, c: np.abs(a - b) * np.sign(b - c),
    "min(a, b, c) + max(a, b)": lambda a, b, c: np.minimum(np.minimum(a, b), c) + np.maximum(a, b),
    "clip(a, 1, 2) + sat(b, 1.5, 2.5)": lambda a, b, c: np.clip(a, 1, 2) + np.clip(b, 1.5, 2.5),
    "floor(a) + ceil(b)": lambda a, b, c: np.floor(a) + np.ceil(b),
    "where(a > b, a, c)": lambda a, b, c: np.where(a > b, a, c),
    "a if a > b else b if b > c else c": lambda a, b, c: np.where(a > b, a, np.where(b > c, b, c)),
    "1 if 1 < a <= 2 else 0": lambda a, b, c: np.where((a > 1) & (a <= 2), 1.0, 0.0),
    "1 if a < b and not b < c or a > 2.5 else 2": lambda a, b, c: np.where(((a < b) & ~(b < c)) | (a > 2.5), 1.0, 2.0),
    "smooth_sign(a - b, 0.3)": lambda a, b, c: np.tanh((a - b) / 0.3),
    "relu(a - b) + pos(b - a)": lambda a, b, c: np.abs(a - b),
    "deadzone(a - b, -0.5, 0.25)": lambda a, b, c: np.where(
        a - b > 0.25, a - b - 0.25, np.where(a - b < -0.5, a - b + 0.5, 0.0)
    ),
    "smooth_abs(a - b, 0.3)": lambda a, b, c: np.hypot(a - b, 0.3),
    "smooth_sat(a, 1, 2, c)": lambda a, b, c: 1 + c * np.log1p(np.exp((a - 1) / c)) - c * np.log1p(np.exp((a - 2) / c)),
    "smooth_deadzone(a - b, -0.5, 0.25, c)": lambda a, b, c: (
        c * np.log1p(np.exp((a - b - 0.25) / c)) - c * np.log1p(np.exp((b - a - 0.5) / c))
    ),
    "quantize(a, 0.7)": lambda a, b, c: 0.7 * np.round(a / 0.7),
    "coulomb(a - b, c, 0.2)": lambda a, b, c: c * np.tanh((a - b) / 0.2),
    "stribeck(a - b, c, 2*c, 0.4, 0.2)": lambda a, b, c: (
        c * (1 + np.exp(-(((a - b) / 0.4) ** 2))) * np.tanh((a - b) / 0.2)
    ),
    "step(a - b)": lambda a, b, c: np.where(a >= b, 1.0, 0.0),
    "(a > b) * c": lambda a, b, c: (a > b) * c,
    "2*pi*a + e": lambda a, b, c: 2 * np.pi * a + np.e,
    "+a - -b": lambda a, b, c: a + b,
    "7": lambda a, b, c: np.full_like(a, 7.0),
}


def test_every_function_is_among_the_expressions():
    missing = [name for name in CALLS if not any(re.search(rf"\b{name}\(", text) for text in EXPRESSIONS)]
    assert missing == [], f"add a row that uses {missing} to EXPRESSIONS here"


@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.further(10)
def test_expression_against_numpy(text):
    a, b, c = np.random.default_rng(RNG_SEED).uniform(0.3, 3.0, (3, 40))
    # z is there so that every input is used
    model = equations(f"y = {text}\nz = a + b + c", inputs=["a", "b", "c"], outputs=["y", "z"])
    inputs = {"a": a, "b": b, "c": c, "t": a * 0}
    found = model.output({}, inputs, {})["y"]
    assert found.shape == a.shape
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, EXPRESSIONS[text](a, b, c), rtol=1e-12, atol=1e-13)
    one_by_one = [float(model.output({}, {k: v[i] for k, v in inputs.items()}, {})["y"]) for i in range(3)]
    np.testing.assert_allclose(found[:3], one_by_one, rtol=1e-14)


TANKS = """
    # two tanks in cascade
    flow1 = a1*sqrt(2*g*max(h1, 0))
    h1' = (k*delay(u, Td) - flow1)/A; h2' = (flow1 - flow2)/A
    flow2 = a2*sqrt(2*g*max(h2,
                            0))
    y = h2 + 0*t
"""


def tanks(**changes):
    given: dict[str, Any] = {
        "inputs": {"u": None},
        "states": {"h1": {"initial": "h10"}, "h2": {"initial": "y + 2*u"}},
        "outputs": {"y": None},
        "parameters": ["k", "a1", "a2", "A", "Td", "h10"],
        "constants": {"g": 981.0},
    }
    return equations(TANKS, **{**given, **changes})


def tanks_by_hand(x, u, p):
    flow = {n: p[f"a{n}"] * np.sqrt(2 * 981.0 * max(x[f"h{n}"], 0)) for n in (1, 2)}
    return {"h1": (p["k"] * u["delay(u, Td)"] - flow[1]) / p["A"], "h2": (flow[1] - flow[2]) / p["A"]}


def random_tanks(seed):
    draw = np.random.default_rng(seed).uniform
    p = {n: draw(0.5, 2.0) for n in ("k", "a1", "a2", "A", "Td", "h10")}
    return {"h1": draw(-1, 5), "h2": draw(-1, 5)}, {"u": draw(), "delay(u, Td)": draw(), "t": 1.0}, p


@pytest.mark.parametrize("seed", range(5))
def test_model_against_function_by_hand(seed):
    model, (x, u, p) = tanks(), random_tanks(seed)
    expected = tanks_by_hand(x, u, p)
    for function in (derivative(model), jax.jit(derivative(model))):
        found = function(x, u, p)
        assert set(found) == {"h1", "h2"}
        for name in expected:
            assert float(found[name]) == pytest.approx(expected[name], rel=1e-12)
    assert float(model.output(x, u, p)["y"]) == x["h2"]


def test_vmap_equals_one_by_one():
    model = tanks()
    points = [random_tanks(seed) for seed in range(4)]
    stacked = jax.tree.map(lambda *v: np.array(v), *points)
    together = jax.vmap(derivative(model))(*stacked)
    for k, point in enumerate(points):
        for name, value in derivative(model)(*point).items():
            assert float(together[name][k]) == pytest.approx(float(value), rel=1e-14)


def test_initial_state_reads_parameters_inputs_and_measured_outputs():
    start = initial_state(tanks())({"h10": 3.0}, {"u": 0.5, "t": 0.0}, {"y": 7.0})
    assert {k: float(v) for k, v in start.items()} == {"h1": 3.0, "h2": 8.0}


def test_initial_state_is_zero_by_default():
    model = equations("x' = -x + u; y = x", inputs=["u"], states=["x"], outputs=["y"])
    assert float(initial_state(model)({}, {"u": 4.0}, {"y": 5.0})["x"]) == 0.0


def test_constants_broadcast_to_the_common_shape():
    model = equations("x' = 2; y = x", states=["x"], outputs=["y"])
    assert derivative(model)({"x": np.zeros(3)}, {"t": np.zeros(3)}, {})["x"].shape == (3,)


def test_output_may_be_a_state_and_feed_other_values():
    model = equations("x' = u - double; double = 2*x; z = double + 1", inputs=["u"], states=["x"], outputs=["x", "z"])
    assert {k: float(v) for k, v in model.output({"x": 3.0}, {"u": 0.0}, {}).items()} == {"x": 3.0, "z": 7.0}


def test_text_and_source_are_kept():
    model = tanks(name="tanks", sentence="Two tanks.", source="by hand")
    assert (model.text, model.name, model.sentence, model.source) == (TANKS, "tanks", "Two tanks.", "by hand")


def test_two_delays_of_one_input():
    text = "y = delay(u, T1) + 10*delay(u, T2) + 100*delay(u, 0.5) + 1000*delay(u, L) + 10000*delay(u, T1)"
    model = equations(text, inputs=["u"], outputs=["y"], parameters=["T1", "T2"], constants={"L": "0.75 s"})
    by_parameter = {d.parameter: d for d in model.delays}
    assert len(model.delays) == 4
    assert {d.input for d in model.delays} == {"u"}
    hidden = {p.name: p.value for p in model.parameters if p.value is not None}
    assert sorted(hidden.values()) == [0.5, 0.75]
    values = {"T1": 1.0, "T2": 2.0, **{name: {0.5: 3.0, 0.75: 4.0}[value] for name, value in hidden.items()}}
    u = {by_parameter[name].channel: value for name, value in values.items()}
    assert float(model.output({}, u, {})["y"]) == 1 + 20 + 300 + 4000 + 10000


MOTOR = """
    i' = (delay(V, Td) - Rm*i - Kb*w)/Lm
    w' = (Kt*i - Cm*w - Tf*tanh(w/w0) - T)/Jm
"""


def test_library_motor_equals_its_text():
    model = dc_motor(current_output=True, dead_time=True, load=True)
    text = equations(
        MOTOR,
        inputs=model.inputs,
        states={"i": {"unit": "A", "initial": "i"}, "w": {"unit": "rad/s", "initial": "w"}},
        outputs=model.outputs,
        parameters={p.name: p for p in model.parameters},
        constants={"w0": "0.1 rad/s"},
    )
    assert text.parameters == model.parameters
    draw = np.random.default_rng(2).uniform
    for _ in range(5):
        x, v, p = {"i": draw(-1, 1), "w": draw(-1, 1)}, draw(), {q.name: draw(0.1, 2) for q in model.parameters}
        mine = derivative(model)(x, {"V": 0.0, "V_delayed": v, "T": 0.3}, p)
        theirs = derivative(text)(x, {"V": 0.0, "delay(V, Td)": v, "T": 0.3}, p)
        for name in x:
            assert float(mine[name]) == pytest.approx(float(theirs[name]), rel=1e-12)
        assert text.output(x, {}, p) == model.output(x, {}, p)
        assert initial_state(text)(p, {"V": 0.0, "T": 0.0}, x) == initial_state(model)(p, {"V": 0.0, "T": 0.0}, x)


@pytest.mark.parametrize(
    ("model", "text", "states"),
    [
        (first_order(dead_time=False), "y' = (K*u + c - y)/tau", ["y"]),
        (second_order(dead_time=False, offset=False), "z' = (K*u - z)/tau1; y' = (z - y)/tau2", ["z", "y"]),
    ],
    ids=["first_order", "second_order"],
)
@pytest.mark.thorough
def test_library_process_equals_its_text(model, text, states):
    written = equations(text, inputs=["u"], states=states, outputs=["y"], parameters=[p.name for p in model.parameters])
    draw = np.random.default_rng(3).uniform
    x, u, p = {s: draw() for s in states}, {"u": draw()}, {q.name: draw(0.5, 2) for q in model.parameters}
    mine, theirs = derivative(model)(x, u, p), derivative(written)(x, u, p)
    for state in states:
        assert float(mine[state]) == pytest.approx(float(theirs[state]), rel=1e-13)
