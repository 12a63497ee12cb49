"""Derivatives against central differences, and without NaN where a branch or a root ends."""

import numpy as np
import pytest
from model_calls import derivative

from plantfit.models import dc_motor, drive, equations

import jax


def value_of(text):
    model = equations(f"y = {text}", inputs=["x"], outputs=["y"])
    return lambda x: model.output({}, {"x": x}, {})["y"]


SMOOTH = (
    "sqrt(x) + log(x) + log10(x) + exp(-x) + x^2.5 + x^-3",
    "sin(x)*cos(x) + tan(x/3) + asin(x/3) + acos(x/3) + atan(x) + atan2(x, 2)",
    "sinh(x) + cosh(x) + tanh(x) + smooth_sign(x, 0.7)",
    "abs(-x) + max(x, 0.1) + min(x, 9) + clip(x, 0, 9) + relu(x) + deadzone(x, -1, 0.3) + sat(x, 0, 1)",
    "x^2/(1 + x) if x > 0.5 else 1/x + x^0.5",
)


@pytest.mark.parametrize("text", SMOOTH)
@pytest.mark.parametrize("at", [0.45, 0.8, 1.7])
@pytest.mark.further(1)
def test_gradient_equals_central_difference(text, at):
    function, h = value_of(text), 1e-6
    difference = (float(function(at + h)) - float(function(at - h))) / (2 * h)
    assert float(jax.grad(function)(at)) == pytest.approx(difference, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("sqrt(max(x, 0))", 0.0),
        ("sqrt(x)", 0.0),
        ("abs(x)", 0.0),
        ("sign(x)", 0.0),
        ("max(x, 0)", 0.0),
        ("x^2", 0.0),
        ("x^0", 1.0),
        ("atan2(x, x)", 0.0),
        ("asin(clip(x + 2, -1, 1))", np.pi / 2),
        ("1/x if x > 0 else 3", 3.0),
        ("x^-1 if x > 0 else 3", 3.0),
        ("x^0.3 if x > 0 else 3", 3.0),
        ("log(x) if x > 0 else 3", 3.0),
        ("sqrt(x - 1) if x > 1 else 3", 3.0),
        ("where(x > 0, (sin(x)/x)^0.5, 3)", 3.0),
    ],
)
@pytest.mark.further(12)
def test_value_and_finite_gradient_at_zero(text, value):
    function = value_of(text)
    assert float(function(0.0)) == pytest.approx(value, abs=1e-15)
    assert np.isfinite(float(jax.grad(function)(0.0)))
    assert np.isfinite(float(jax.jacfwd(function)(0.0)))


@pytest.mark.parametrize(
    ("text", "value"), [("log(x)", -np.inf), ("sqrt(x - 1)", np.nan), ("1/x", np.inf), ("1/x if x < 1 else 2", np.inf)]
)
def test_values_outside_the_domain_are_not_hidden(text, value):
    np.testing.assert_equal(float(value_of(text)(0.0)), value)


@pytest.mark.parametrize(
    "model", [dc_motor(dead_time=True), drive(velocity_output=True, smooth_width=0.5)], ids=["dc_motor", "drive"]
)
@pytest.mark.thorough
def test_library_jacobian_equals_central_difference(model):
    draw = np.random.default_rng(1).uniform
    names = [p.name for p in model.parameters if p.name != "Td"]
    states = list(model.states)
    u = {**{i: draw() for i in model.inputs}, **{d.channel: draw() for d in model.delays}}

    def rates(v):
        found = derivative(model)(
            dict(zip(states, v, strict=False)), u, {**dict(zip(names, v[len(states) :], strict=True)), "Td": 0.1}
        )
        return jax.numpy.stack([found[s] for s in states])

    at, h = draw(0.5, 1.5, len(states) + len(names)), 1e-6
    found = np.asarray(jax.jacfwd(rates)(at))
    for k, direction in enumerate(np.eye(len(at)) * h):
        np.testing.assert_allclose(
            found[:, k], (rates(at + direction) - rates(at - direction)) / (2 * h), rtol=1e-6, atol=1e-7
        )
