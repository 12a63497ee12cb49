"""Blended regulators: memberships, the single rule, and the blend between two rules written out."""

import numpy as np
import pytest
from plants import PERIOD, STICK, stick, upright

from plantfit.control import discretised, kalman_observer, linearised, lqr, takagi_sugeno
from plantfit.control.linear.lqr import regulator
from plantfit.control.linear.takagi_sugeno import memberships
from plantfit.errors import SimulationError

import jax.numpy as jnp

BOTH = ("q", "w")


def leaning(q: float, measured=BOTH):
    """The stick held at an angle by a torque."""
    return linearised(stick(measured), STICK, {"q": q}, {"u": -STICK["a"] / STICK["b"] * np.sin(q)})


def test_memberships_are_triangles_that_add_up_to_one():
    centres = jnp.array([-1.0, 0.0, 3.0])
    table = {
        -5.0: [1, 0, 0],
        -1.0: [1, 0, 0],
        -0.25: [0.25, 0.75, 0],
        0.0: [0, 1, 0],
        2.0: [0, 1 / 3, 2 / 3],
        9.0: [0, 0, 1],
    }
    for value, shares in table.items():
        np.testing.assert_allclose(memberships(value, centres), shares, atol=1e-15)


@pytest.mark.thorough
def test_one_rule_is_the_regulator():
    plant = upright()
    estimator = kalman_observer(plant, PERIOD, {"w": 1.0}, 1e-3)
    weights = ({"q": 1.0}, {"u": 0.2})
    one = takagi_sugeno([plant], PERIOD, *weights, premise="q", hold=0, estimators=[estimator], limits=(-1.0, 1.0))
    same = lqr(plant, PERIOD, *weights, estimator=estimator, limits=(-1.0, 1.0))
    runs = [
        d.close(stick()).simulate(d.parameters, STICK, {"q": 0.05}, samples=100, x0={"q": 0.2}).u["u"]
        for d in (one, same)
    ]
    np.testing.assert_allclose(*runs, rtol=1e-9, atol=1e-12)


def test_between_rules_gains_are_blended():
    plants = [leaning(q) for q in (-1.2, 0.0, 1.2)]
    design = takagi_sugeno(plants, PERIOD, {"q": 1.0}, {"u": 0.2}, premise="q", hold=1)
    gains = [regulator(discretised(p, PERIOD), np.diag([1.0, 0.0]), np.array([[0.2]]))[0] for p in plants]
    assert gains[0][0, 0] < 0.9 * gains[1][0, 0]  # a stick that leans falls less
    seen = design.close(stick(BOTH), stepper="rk4").simulate(
        design.parameters, STICK, {}, samples=150, x0={"q": 0.9, "w": 0.4}
    )
    q, w = np.asarray(seen.states["q"]), np.asarray(seen.states["w"])
    share = np.clip(np.abs(q) / 1.2, 0.0, 1.0)
    mixed = share[:, None] * gains[0][0] + (1.0 - share)[:, None] * gains[1][0]
    np.testing.assert_allclose(seen.command["u"], -(mixed[:, 0] * q + mixed[:, 1] * w), rtol=1e-9, atol=1e-12)
    assert abs(q[-1]) < 1e-3


@pytest.mark.thorough
def test_blended_filters_know_the_plant_away_from_the_held_point():
    """At rest at an operating point that is not the held one, its own filter predicts no motion."""
    plants = [leaning(q, ("q",)) for q in (-0.8, 0.0, 0.8)]
    filters = [kalman_observer(p, PERIOD, {"w": 0.3}, 1e-3) for p in plants]
    design = takagi_sugeno(plants, PERIOD, {"q": 1.0}, {"u": 0.2}, premise="q", hold=1, estimators=filters)
    held = {"q": 0.8, "u": float(plants[2].u0[0])}
    seen = design.close(stick()).simulate(design.parameters, STICK, held, samples=100, x0={"q": 0.8})
    np.testing.assert_allclose(seen.y["q"], 0.8, atol=2e-2)
    assert abs(float(seen.y["q"][-1]) - 0.8) < 1e-6


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: takagi_sugeno([], PERIOD, 1.0, 1.0, premise="q", hold=0), "0 operating points"),
        (lambda: takagi_sugeno([upright(BOTH)], PERIOD, 1.0, 1.0, premise="q", hold=1), "hold = 1"),
        (lambda: takagi_sugeno([upright(BOTH)], PERIOD, 1.0, 1.0, premise="u", hold=0), "'u' is not measured"),
        (
            lambda: takagi_sugeno([leaning(0.1), leaning(0.3, ("q",))], PERIOD, 1.0, 1.0, premise="q", hold=0),
            "linearise one model",
        ),
        (
            lambda: takagi_sugeno([leaning(0.3), leaning(0.1)], PERIOD, 1.0, 1.0, premise="q", hold=0),
            "increasing order",
        ),
        (
            lambda: takagi_sugeno([leaning(0.1), leaning(0.3)], PERIOD, 1.0, 1.0, premise="q", hold=0, estimators=[]),
            "0 estimators",
        ),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()
