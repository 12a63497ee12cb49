"""Loops over several outputs and inputs, each with its own sensor and actuator, against a plain loop over the
samples."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.models.text.equations import equations
from plantfit.simulate.loop.closed_loop import Controller, Observer, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

import jax
import jax.numpy as jnp

PERIOD = 0.02
PLANT = {"k": 3.0, "c": 0.4}
A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-3.0, 3.0, -0.4, 0], [3.0, -3.0, 0, -0.4]])
B = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 1]], dtype=float)
GAINS = {"q": np.array([2.0, 0.7]), "s": np.array([-0.3, 1.5])}
SENSORS = {"q": Sensor(quantum=0.01, delay=2), "s": Sensor(every=3, delay=9)}
ACTUATORS = {"F": Actuator(-1.0, 1.0, delay=1, rest=0.3), "G": Actuator(-0.5, 2.0, quantum=0.05, gain=1.2)}


def carts() -> Model:
    """Two carts of 1 kg joined by a spring; forces F, G and a load T on the second."""
    text = "q' = v\ns' = w\nv' = F - k*(q - s) - c*v\nw' = G + T + k*(q - s) - c*w"
    return equations(
        text,
        inputs=["F", "G", "T"],
        states=["q", "s", "v", "w"],
        outputs=["s", "q"],
        parameters=dict.fromkeys("kc"),
        name="carts",
    )


def update(state, measured, reference, gains):
    errors = {name: reference[name] - measured[name] for name in measured}
    sums = state + jnp.array([errors["q"], errors["s"]])
    both = gains["q"] * errors["q"] + gains["s"] * errors["s"] + 0.05 * sums
    return sums, {"F": both[0], "G": both[1]}


FEEDBACK = Controller(lambda measured, gains: jnp.array([measured["q"], 0.0]), update)


def loop(**changes):
    chosen: dict[str, Any] = {"output": ["q", "s"], "input": ["G", "F"], "sensor": SENSORS, "actuator": ACTUATORS}
    return closed_loop(carts(), FEEDBACK, period=PERIOD, **chosen | changes)


def rounded(value, quantum):
    return quantum * np.round(value / quantum) if quantum else value


def plain(reference, load, noise, x):
    """The loop written out: y (n, 2), u (n, 2)."""
    big = np.zeros((7, 7))
    big[:4, :4], big[:4, 4:] = A, B
    held = expm(big * PERIOD)[:4]
    sensed = {"q": [], "s": []}
    commands, seen = {"F": [], "G": []}, []
    sums = np.zeros(2)
    for k in range(len(load)):
        for place, (name, sensor) in enumerate(SENSORS.items()):
            if k % sensor.every == 0:
                fresh = rounded(x[place] + noise.get(name, np.zeros(len(load)))[k], sensor.quantum)
            else:
                fresh = sensed[name][-1]
            sensed[name].append(fresh)
        measured = {name: sensed[name][max(k - s.delay, 0)] for name, s in SENSORS.items()}
        if k == 0:
            sums = np.array([measured["q"], 0.0])
        errors = {"q": reference["q"] - measured["q"], "s": reference["s"][k] - measured["s"]}
        sums = sums + np.array([errors["q"], errors["s"]])
        both = GAINS["q"] * errors["q"] + GAINS["s"] * errors["s"] + 0.05 * sums
        u = []
        for name, value in zip("FG", both, strict=True):
            commands[name].append(value)
            a = ACTUATORS[name]
            late = commands[name][k - a.delay] if k >= a.delay else a.rest
            u.append(a.gain * rounded(np.clip(late, a.lower, a.upper), a.quantum))
        seen.append((*x[:2], *u))
        x = held @ [*x, *u, load[k]]
    seen = np.array(seen)
    return seen[:, :2], seen[:, 2:]


@pytest.mark.parametrize("stepper", ["exact", "rk4"])
def test_equals_a_plain_loop(stepper):
    n = 200
    rng = np.random.default_rng(3)
    reference = {"q": 0.4, "s": np.where(np.arange(n) < 80, 0.5, -0.2)}
    load, noise = 0.1 * np.sin(0.1 * np.arange(n)), {"s": 0.01 * rng.normal(size=n)}
    x0 = {"q": 0.2, "w": -0.3}
    seen = loop(stepper=stepper, substeps=8).simulate(GAINS, PLANT, reference, x0=x0, inputs={"T": load}, noise=noise)
    y, u = plain(reference, load, noise, np.array([0.2, 0.0, 0.0, -0.3]))
    # quanta may fall apart later by the last bits
    for place, name in enumerate("qs"):
        np.testing.assert_allclose(seen.y[name][:60], y[:60, place], atol=2e-7)
    for place, name in enumerate("FG"):
        np.testing.assert_allclose(seen.u[name][:60], u[:60, place], atol=2e-6)
    assert np.ptp(u[:60], axis=0).min() > 0.3


def test_initial_states_are_batched_with_vmap():
    starts = np.array([-0.413, 0.017, 0.732])
    ours = loop()
    reference, n = {"q": 0.1, "s": np.full(50, 0.1)}, 50

    def run(q):
        return ours.simulate(GAINS, PLANT, reference, x0={"q": q}, inputs={"T": 0.0})

    many = jax.vmap(run)(jnp.asarray(starts))
    for row, q in enumerate(starts):
        y, _ = plain(reference, np.zeros(n), {}, np.array([q, 0.0, 0.0, 0.0]))
        np.testing.assert_allclose(many.y["s"][row], y[:, 1], atol=1e-6)


def test_an_observer_sees_signals_by_name():
    def add(seen, t, y, u, reference):
        return seen[0] + y["q"] + 2.0 * y["s"], seen[1] + u["F"] - u["G"], seen[2] + reference["s"]

    total = Observer(lambda y, r: (0.0, 0.0, 0.0), add, lambda seen: seen)
    reference = {"q": 0.4, "s": np.linspace(0.0, 1.0, 40)}
    ours = loop()
    folded = ours.observe(total, GAINS, PLANT, reference, inputs={"T": 0.0})
    stored = ours.simulate(GAINS, PLANT, reference, inputs={"T": 0.0})
    expected = (stored.y["q"] + 2.0 * stored.y["s"]).sum(), (stored.u["F"] - stored.u["G"]).sum(), 20.0
    np.testing.assert_allclose(folded, expected, rtol=1e-12)


def test_a_controller_without_references():
    rest = Controller(lambda y, p: (), lambda s, y, r, p: (s, {"F": -p * y["q"], "G": -p * y["s"]}))
    seen = closed_loop(carts(), rest, period=PERIOD, output=["q", "s"], input=["F", "G"]).simulate(
        1.0, PLANT, {}, samples=2000, x0={"q": 1.0}, inputs={"T": 0.0}
    )
    assert abs(seen.y["q"][-1]) < 1e-2


def one_number():
    odd = Controller(lambda y, p: (), lambda s, y, r, p: (s, 0.0))
    return closed_loop(carts(), odd, period=PERIOD, output=["q"], input=["F", "G"])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: loop(output=["q", "z"]), "'z' is not one of them"),
        (lambda: loop(output=["q", "q"]), "name each once"),
        (lambda: loop(input=[]), "none was named"),
        (lambda: loop(sensor={"q": Sensor()}), "one for each of"),
        (lambda: loop(actuator=3.0), "actuator is 3.0"),
        (
            lambda: loop().simulate(
                GAINS, PLANT, {"q": 0.0, "s": 0.0}, samples=5, inputs={"T": 0.0}, noise=np.zeros(5)
            ),
            "mapping with an array",
        ),
        (
            lambda: loop().simulate(GAINS, PLANT, {"q": 0.0, "s": 0.0}, samples=5, inputs={"T": 0.0}, noise={"v": 0.0}),
            "noise names 'v'",
        ),
        (
            lambda: loop().simulate(GAINS, PLANT, {"q": 0.0, "s": np.zeros(4)}, samples=5, inputs={"T": 0.0}),
            "reference s has 4 values",
        ),
        (lambda: loop().simulate(GAINS, PLANT, {}, inputs={"T": 0.0}), "give samples = N"),
        (lambda: one_number().simulate(0.0, PLANT, {}, samples=5, inputs={"T": 0.0}), "commands one number"),
        (
            lambda: loop(input="F", actuator=Actuator()).simulate(
                GAINS, PLANT, {"q": 0.0, "s": 0.0}, samples=5, inputs={"T": 0.0, "G": 0.0}
            ),
            "commands",
        ),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()


def test_a_plant_with_dry_friction_is_refused():
    block = equations(
        "v' = F - friction(v, 1.0, 1.0)", inputs=["F"], states=["v"], outputs=["v"], parameters={}, name="block"
    )
    assert not block.smooth
    with pytest.raises(SimulationError, match="dry friction"):
        closed_loop(block, FEEDBACK, period=PERIOD)
