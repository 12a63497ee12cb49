"""Friction laws and rounded nonlinearities against closed forms and their sharp limits."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plantfit.errors import EquationError
from plantfit.models import (
    coulomb,
    equations,
    lugre,
    quantize,
    smooth_abs,
    smooth_deadzone,
    smooth_sat,
    stribeck,
    viscous,
)

import jax

V = np.linspace(-3, 3, 61)


def test_laws_are_odd_and_have_their_limits():
    for law in (lambda v: viscous(v, 0.7), lambda v: coulomb(v, 2.0, 0.1), lambda v: stribeck(v, 2.0, 3.0, 0.5, 0.01)):
        np.testing.assert_allclose(law(V), -law(-V), atol=1e-15)
    assert float(coulomb(9.0, 2.0, 0.1)) == pytest.approx(2.0, rel=1e-12)
    assert float(stribeck(50.0, 2.0, 3.0, 0.5, 0.01)) == pytest.approx(2.0, rel=1e-12)
    assert float(stribeck(0.05, 2.0, 3.0, 0.5, 1e-4)) == pytest.approx(2 + np.exp(-0.01), rel=1e-12)
    np.testing.assert_allclose(stribeck(V, 2.0, 2.0, 0.5, 0.1), coulomb(V, 2.0, 0.1), rtol=1e-14)


LUGRE = (1e3, 30.0, 0.4, 1.0, 1.5, 0.01)


@pytest.mark.parametrize("v", [-0.02, 0.004, 0.1])
def test_lugre_slides_into_the_stribeck_curve(v):
    sigma0, _, sigma2, fc, fs, vs = LUGRE
    z = solve_ivp(lambda t, z: [float(lugre(v, z[0], *LUGRE)[1])], (0, 5), [0.0], "LSODA", rtol=1e-9, atol=1e-12).y[
        0, -1
    ]
    level = np.sign(v) * (fc + (fs - fc) * np.exp(-((v / vs) ** 2)))
    assert sigma0 * z == pytest.approx(level, rel=1e-6)
    assert float(lugre(v, z, *LUGRE)[0]) == pytest.approx(level + sigma2 * v, rel=1e-6)


def test_lugre_sticks_as_a_spring_and_damper():
    force, rate = lugre(0.0, 2e-4, *LUGRE)
    assert (float(force), float(rate)) == (LUGRE[0] * 2e-4, 0.0)
    assert np.isfinite(jax.grad(lambda v: lugre(v, 2e-4, *LUGRE)[0])(0.0))


def test_rounded_forms_near_and_far_from_their_corners():
    width, x = 0.01, np.linspace(-3, 3, 241)
    np.testing.assert_allclose(smooth_abs(x, width), np.sqrt(x**2 + width**2), rtol=1e-14)
    clipped = np.clip(x, -1, 2)
    assert np.max(np.abs(smooth_sat(x, -1, 2, width) - clipped)) == pytest.approx(width * np.log(2), rel=1e-9)
    far = np.minimum(np.abs(x + 1), np.abs(x - 2)) > 0.5
    np.testing.assert_allclose(smooth_sat(x, -1, 2, width)[far], clipped[far], atol=1e-15)
    np.testing.assert_allclose(smooth_deadzone(x, -1, 2, width), x - smooth_sat(x, -1, 2, width), atol=1e-14)


@pytest.mark.parametrize(
    "form",
    [lambda x: smooth_abs(x, 0.2), lambda x: smooth_sat(x, -1, 2, 0.2), lambda x: smooth_deadzone(x, -1, 2, 0.2)],
)
@pytest.mark.further(1)
def test_rounded_forms_have_two_smooth_derivatives(form):
    h = 1e-5
    for x in (-1.0, 0.0, 0.3, 2.0):
        assert float(jax.grad(form)(x)) == pytest.approx(float(form(x + h) - form(x - h)) / (2 * h), rel=1e-7, abs=1e-9)
        second = (jax.grad(form)(x + h) - jax.grad(form)(x - h)) / (2 * h)
        assert float(jax.grad(jax.grad(form))(x)) == pytest.approx(float(second), rel=1e-6, abs=1e-8)
    assert np.all(np.isfinite(jax.vmap(jax.grad(form))(np.array([-1e6, 1e6]))))


def test_quantize_rounds_and_passes_the_derivative():
    x = np.array([-1.26, -0.24, 0.0, 0.26, 0.74, 1e6 + 0.3])
    np.testing.assert_array_equal(quantize(x, 0.5), [-1.5, 0.0, 0.0, 0.5, 0.5, 1e6 + 0.5])
    assert float(jax.grad(quantize)(0.3, 0.5)) == 1.0
    assert float(jax.grad(quantize, 1)(0.3, 0.5)) == 0.0
    np.testing.assert_allclose(quantize(3 * x, 1.5), 3 * quantize(x, 0.5), rtol=1e-15)


TEXTS = {
    "coulomb(v, Fc, w)": lambda v, Fc, Fs, vs, w: Fc * np.tanh(v / w),
    "stribeck(v, Fc, Fs, vs, w)": lambda v, Fc, Fs, vs, w: (Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2))) * np.tanh(v / w),
    "smooth_abs(v, w)": lambda v, Fc, Fs, vs, w: np.hypot(v, w),
    "smooth_sat(v, 0 - vs, vs, w)": lambda v, Fc, Fs, vs, w: smooth_sat(v, -vs, vs, w),
    "smooth_deadzone(v, 0 - vs, vs, w)": lambda v, Fc, Fs, vs, w: smooth_deadzone(v, -vs, vs, w),
    "quantize(v, w)": lambda v, Fc, Fs, vs, w: w * np.round(v / w),
}


def build(text, unit):
    given = {"v": "m/s", "Fc": "N", "Fs": "N", "vs": "m/s", "w": "m/s"}
    return equations(f"y = {text}; all = (v + vs + w)*(Fc + Fs)", inputs=given, outputs={"y": unit, "all": None})


@pytest.mark.parametrize("text", TEXTS)
def test_functions_in_text_with_their_units(text):
    model = build(text, "N" if "Fc" in text else "m/s")
    names: list[str] = ["v", "Fc", "Fs", "vs", "w"]
    values = dict(zip(names, np.random.default_rng(1).uniform(0.1, 2, (5, 20)), strict=True))
    np.testing.assert_allclose(model.output({}, values, {})["y"], TEXTS[text](**values), rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "column", "words"),
    [
        ("coulomb(v, Fc, 0.01)", "N", 19, "The number 0.01 has no unit"),
        ("coulomb(v, Fc, Fs)", "N", 4, "'coulomb' joins m/s and N"),
        ("coulomb(v, Fc, w)", "m/s", 4, "must be in m/s"),
        ("stribeck(v, Fc, vs, Fs, w)", "N", 4, "'stribeck' joins"),
        ("quantize(v, Fc)", "m/s", 4, "'quantize' joins m/s and N"),
        ("smooth_sat(v, 0, 1, w)", "m/s", 21, "The number 1 has no unit"),
    ],
)
def test_misfitting_units_are_shown_where_they_are(text, unit, column, words):
    with pytest.raises(EquationError) as caught:
        build(text, unit)
    assert words in caught.value.reason
    assert (caught.value.line, caught.value.column) == (0, column)
