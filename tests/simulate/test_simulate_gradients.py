"""Derivatives of a stiff plant: against its own differences, and against a tight solver of its own."""

from functools import cache

import numpy as np
import pytest
from simulate_plants import P, exact, record, stiff

import plantfit.runtime  # noqa: F401
from plantfit.simulate import Simulator
from plantfit.simulate.check.tight import follow
from plantfit.simulate.steps.registry import FIXED

import jax
import jax.numpy as jnp

TARGET = np.sin(np.arange(60) / 7.0)


def simulator_of(hold="previous", substeps=1, stepper="rosenbrock"):
    return Simulator.of(stiff(), hold={"u": hold}, substeps=substeps, stepper=stepper)


def cost_of(simulator, drive):
    def cost(p):
        return jnp.mean((simulator.outputs(p, drive)["y"] - TARGET) ** 2)

    return jax.jit(cost)


@cache
def gradient_of(hold, irregular):
    """The cost of a record, and its derivative by all parameters, compiled once."""
    t, u = record(irregular)
    simulator = simulator_of(hold, substeps=8)
    cost = cost_of(simulator, simulator.drive(t, {"u": u}))
    return cost, jax.jit(jax.grad(cost))


def floats(p):
    return {k: jnp.asarray(float(v)) for k, v in p.items()}


def richardson(f, p, name, h):
    def central(h):
        return (float(f(p | {name: p[name] + h})) - float(f(p | {name: p[name] - h}))) / (2 * h)

    return (4 * central(h / 2) - central(h)) / 3


@pytest.mark.parametrize(
    ("hold", "irregular"),
    [
        ("previous", False),
        ("previous", True),
        ("linear", False),
        pytest.param("linear", True, marks=pytest.mark.slow),
    ],
)
@pytest.mark.further(1)
def test_gradient_equals_central_differences_of_its_own_cost(hold, irregular):
    cost, gradient_at = gradient_of(hold, irregular)
    p = floats(P | {"e": 0.2})
    gradient = gradient_at(p)
    for name in P:
        expected = richardson(cost, p, name, 1e-4 if name == "Td" else 5e-4 * abs(float(p[name])))
        assert float(gradient[name]) == pytest.approx(expected, rel=1e-6), name


@pytest.mark.parametrize(
    ("delay", "hold", "irregular"),
    [
        (0.0, "previous", False),
        (0.04, "previous", False),
        (0.3, "previous", False),
        (0.37, "previous", False),
        (0.37, "previous", True),
        (0.0, "linear", False),
        (0.3, "linear", False),
        (0.37, "linear", False),
    ],
)
def test_derivative_by_dead_time_equals_that_of_a_tight_solver(delay, hold, irregular):
    t, u = record(irregular)
    p = P | {"Td": delay}
    gradient = gradient_of(hold, irregular)[1](floats(p))

    def tight(delay):
        return np.mean((exact(p | {"Td": delay}, t, u, hold)[1] - TARGET) ** 2)

    h = 1e-4
    if delay == 0.0:  # only one side exists
        expected = (-3 * tight(0.0) + 4 * tight(h) - tight(2 * h)) / (2 * h)
    else:
        expected = (tight(delay + h) - tight(delay - h)) / (2 * h)
    # the scale: the largest derivative by the logarithm of a parameter, per second of dead time
    scale = max(abs(float(gradient[n]) * P[n]) for n in P if n != "Td")
    assert abs(expected) > 0.05 * scale
    assert float(gradient["Td"]) == pytest.approx(expected, abs=0.01 * scale, rel=0.01)


def test_all_derivatives_together_equal_those_of_a_tight_solver():
    t, u = record()
    gradient = gradient_of("previous", False)[1](floats(P))
    rng = np.random.default_rng(0)
    scale = max(abs(float(gradient[n]) * max(abs(P[n]), 0.1)) for n in P)
    for _ in range(3):
        move = {n: rng.choice([-1.0, 1.0]) * max(abs(P[n]), 0.1) for n in P if n != "e"}

        def tight(h, move=move):
            p = {n: P[n] + h * move.get(n, 0.0) for n in P}
            return np.mean((exact(p, t, u)[1] - TARGET) ** 2)

        expected = (tight(1e-4) - tight(-1e-4)) / 2e-4
        assert sum(float(gradient[n]) * move[n] for n in move) == pytest.approx(expected, abs=0.01 * scale)


@pytest.mark.parametrize("stepper", [pytest.param(s, marks=pytest.mark.slow) if s == "rk4" else s for s in FIXED])
@pytest.mark.thorough
def test_forward_and_reverse_derivatives_agree(stepper):
    simulator = simulator_of(substeps=4, stepper=stepper)  # rk4 is stable to 2.8 T1 = 56 ms
    t, u = record()
    drive = simulator.drive(t, {"u": u})
    names, rng = list(P), np.random.default_rng(5)
    vector, move, weight = (
        jnp.array([P[n] for n in names]),
        jnp.array(rng.normal(size=len(P))),
        jnp.array(rng.normal(size=len(t))),
    )

    def outputs(v):
        return simulator.outputs(dict(zip(names, v, strict=True)), drive)["y"]

    both = jax.jit(lambda v: (jax.jvp(outputs, (v,), (move,))[1], jax.vjp(outputs, v)[1](weight)[0]))
    forward, reverse = both(vector)
    assert float(weight @ forward) == pytest.approx(float(reverse @ move), rel=1e-10)


@pytest.mark.parametrize("hold", ["previous", "linear"])
def test_tight_states_equal_an_independent_solver(hold):
    t, u = record(irregular=True)
    simulator = simulator_of(hold)
    ours = follow(simulator, floats(P), simulator.drive(t, {"u": u})).states
    np.testing.assert_allclose(ours, exact(P, t, u, hold), atol=1e-7)
