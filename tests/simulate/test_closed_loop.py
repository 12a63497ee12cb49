"""Closed loops against a plain loop over the samples, closed forms and tight solvers."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import plantfit.runtime  # noqa: F401
from plantfit.control import Gains, pid, step_metrics, step_observer
from plantfit.errors import SimulationError
from plantfit.models.model import Declared, Delay, Model
from plantfit.simulate.loop.closed_loop import Controller, Observer, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor
from plantfit.simulate.steps.registry import FIXED, STEPPERS

import jax
import jax.numpy as jnp

MOTOR = {"R": 2.76, "L": 0.0112, "K": 0.005, "B": 1.13e-6, "J": 2.27e-8}
PERIOD = 1e-3
GAINS = Gains(0.8, 6.0, 0.002)


def motor(load: bool = False, feedthrough: float = 0.0) -> Model:
    """A DC motor; with `load` a torque in N m is a second input."""

    def derivative(x, u, p):
        torque = p["K"] * x["i"] - p["B"] * x["w"] - (u["T"] if load else 0.0)
        return {"i": (u["V"] - p["R"] * x["i"] - p["K"] * x["w"]) / p["L"], "w": torque / p["J"]}

    return Model(
        name="motor",
        states={"i": None, "w": None},
        inputs={"V": None, "T": None} if load else {"V": None},
        outputs={"w": None},
        parameters=tuple(Declared(n) for n in MOTOR),
        derivative=derivative,
        output=lambda x, u, p: {"w": x["w"] + feedthrough * u["V"]},
    )


def tank() -> Model:
    """h' = (u - a sqrt(h)) / A, not linear."""
    return Model(
        name="tank",
        states={"h": None},
        inputs={"u": None},
        outputs={"h": None},
        parameters=(Declared("a"), Declared("A")),
        derivative=lambda x, u, p: {"h": (u["u"] - p["a"] * jnp.sqrt(jnp.maximum(x["h"], 0.0) + 1e-6)) / p["A"]},
        output=lambda x, u, p: {"h": x["h"]},
    )


def rounded(value, quantum):
    return quantum * np.round(value / quantum) if quantum else value


def plain_loop(sensor, actuator, reference, gains, noise, torque):
    """The motor's loop written out with lists, for a PID that clamps at the actuator's limits: (y, command, u), each
    (n,)."""
    ohms, inductance, k, b, j = MOTOR.values()
    big = np.zeros((4, 4))
    big[0], big[1, :2], big[1, 3] = [-ohms / inductance, -k / inductance, 1 / inductance, 0], [k / j, -b / j], -1 / j
    held = expm(big * PERIOD)[:2]
    kp, ki, kd = gains[:3]
    x, sensed, commands, seen = np.zeros(2), [], [], []
    integral = last = 0.0
    for n, r in enumerate(reference):
        if n % sensor.every == 0:
            fresh = rounded(x[1] + noise[n], sensor.quantum)
        sensed.append(fresh)  # pyrefly: ignore[unbound-name]  (read at n = 0)
        measured = sensed[max(n - sensor.delay, 0)]
        error = r - measured
        added = ki * PERIOD / 2 * (error + last)
        wanted = kp * error + integral + added + kd * (error - last) / PERIOD
        if not ((wanted > actuator.upper and added > 0) or (wanted < actuator.lower and added < 0)):
            integral += added
        last = error
        commands.append(np.clip(wanted, actuator.lower, actuator.upper))
        late = n - actuator.delay
        u = actuator.gain * rounded(
            np.clip(commands[late] if late >= 0 else actuator.rest, actuator.lower, actuator.upper), actuator.quantum
        )
        seen.append((x[1], commands[-1], u))
        x = held @ [*x, u, torque[n]]
    return np.array(seen).T


CHAINS = {
    "bare": (Sensor(), Actuator(lower=-255.0, upper=255.0, gain=12 / 255)),
    "pwm": (Sensor(), Actuator.pwm(12.0)),
    "both directions": (Sensor(), Actuator.pwm(12.0, bits=6, both_directions=True)),
    "coarse sensor": (Sensor(quantum=2.5), Actuator.pwm(12.0)),
    "late sensor": (Sensor(delay=3), Actuator.pwm(12.0)),
    "very late": (Sensor(delay=11, quantum=0.5), Actuator.pwm(12.0, delay=9)),
    "slow sensor": (Sensor(every=4, delay=2), Actuator.pwm(12.0, delay=1)),
    "begun elsewhere": (Sensor(), Actuator(0.0, 255.0, 1.0, 12 / 255, delay=5, rest=40.2)),
}


@pytest.mark.parametrize(("chain", "stepper"), [*((c, "exact") for c in CHAINS), ("pwm", "rk4"), ("very late", "rk4")])
@pytest.mark.further(3)
def test_equals_a_plain_loop(chain, stepper):
    sensor, actuator = CHAINS[chain]
    rng = np.random.default_rng(2)
    n = 300
    reference, torque = np.where(np.arange(n) < 150, 300.0, 120.0), 1e-4 * np.sin(0.05 * np.arange(n))
    noise = np.r_[0.0, rng.normal(size=n - 1)]
    controller = pid(PERIOD, lower=actuator.lower, upper=actuator.upper)
    loop = closed_loop(
        motor(load=True),
        controller,
        period=PERIOD,
        input="V",
        sensor=sensor,
        actuator=actuator,
        stepper=stepper,
        substeps=20,
    )
    ours = loop.simulate(GAINS, MOTOR, reference, inputs={"T": torque}, noise=noise)
    y, command, u = plain_loop(sensor, actuator, reference, GAINS, noise, torque)
    # rounding may fall apart after the last bits do, which a wrong order of operations would not wait for
    same = np.abs(np.asarray(ours.y) - y) <= 1e-6 * np.max(np.abs(y))
    assert np.all(same[:100])
    if sensor.quantum == 0 and actuator.quantum == 0:
        assert np.all(same)
        np.testing.assert_allclose(ours.command, command, atol=1e-4)
    assert np.max(np.abs(np.asarray(ours.u)[:50] - u[:50])) < 1e-6
    assert np.ptp(y) > 100.0


def test_a_proportional_loop_has_its_closed_form():
    lag = Model(
        name="lag",
        states={"y": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("T"),),
        derivative=lambda x, u, p: {"y": (u["u"] - x["y"]) / p["T"]},
        output=lambda x, u, p: {"y": x["y"]},
    )
    loop = closed_loop(lag, pid(0.1), period=0.1)
    seen = loop.simulate(Gains(3.0), {"T": 0.7}, 2.0, samples=40, x0={"y": -1.0})
    a = np.exp(-0.1 / 0.7)
    pole, rest = a - (1 - a) * 3.0, 2.0 * 3.0 / 4.0
    np.testing.assert_allclose(seen.y, rest + (-1.0 - rest) * pole ** np.arange(40), rtol=1e-12)
    np.testing.assert_allclose(seen.t, 0.1 * np.arange(40), rtol=1e-15)


@pytest.mark.parametrize("stepper", FIXED)
@pytest.mark.further(2)
def test_plants_that_are_not_linear_converge_to_a_tight_solver(stepper):
    plant, h = {"a": 0.8, "A": 2.0}, 2.0
    controller = pid(h, lower=0.0, upper=3.0)
    exact, x, state = [], 0.5, controller.init(jnp.asarray(0.5), GAINS)
    for _ in range(12):
        exact.append(x)
        state, u = controller.update(state, jnp.asarray(x), 1.5, Gains(2.0, 0.3))
        rate = lambda t, h, u=float(u): [(u - 0.8 * np.sqrt(max(h[0], 0.0) + 1e-6)) / 2.0]  # noqa: E731
        x = solve_ivp(rate, (0, h), [x], "DOP853", rtol=1e-12, atol=1e-13).y[0, -1]
    worst = []
    for substeps in (3, 6):
        loop = closed_loop(tank(), controller, period=h, stepper=stepper, substeps=substeps)
        seen = loop.simulate(Gains(2.0, 0.3), plant, 1.5, samples=12, x0={"h": 0.5})
        worst.append(np.max(np.abs(seen.y - np.array(exact))))
    assert worst[0] < 0.05
    assert np.log2(worst[0] / worst[1]) == pytest.approx(STEPPERS[stepper].order, abs=0.7)


def test_auto_is_exact_where_possible():
    assert closed_loop(motor(), pid(PERIOD), period=PERIOD).stepper == "exact"
    assert closed_loop(tank(), pid(PERIOD), period=PERIOD).stepper == "rosenbrock"


def test_time_may_enter_a_linear_plant():
    ramp = Model(
        name="ramp",
        states={"y": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("k"),),
        derivative=lambda x, u, p: {"y": p["k"] * u["t"] + u["u"]},
        output=lambda x, u, p: {"y": x["y"]},
    )
    for stepper in ("exact", "rk4"):
        seen = closed_loop(ramp, pid(0.5), period=0.5, stepper=stepper).simulate(
            Gains(0.0), {"k": 3.0}, 0.0, samples=20
        )
        np.testing.assert_allclose(seen.y, 1.5 * np.asarray(seen.t) ** 2, rtol=1e-12, atol=1e-12)


def test_an_output_that_reads_the_input_sees_the_one_that_is_held():
    loop = closed_loop(motor(feedthrough=2.0), pid(PERIOD), period=PERIOD)
    seen = loop.simulate(GAINS, MOTOR, 100.0, samples=50)
    np.testing.assert_allclose(
        seen.y, seen.states["w"] + 2.0 * np.r_[0.0, np.asarray(seen.u)[:-1]], rtol=1e-12, atol=1e-12
    )


def batch(loop, count=7):
    """Arguments of `count` loops, and the function that runs one of them."""
    rng = np.random.default_rng(5)
    rows = {
        "gains": rng.uniform([0.02, 1.0, 0.0], [0.15, 10.0, 1e-4], size=(count, 3)),
        "R": rng.uniform(2.0, 4.0, count),
        "reference": np.abs(rng.normal(300.0, 40.0, count)),
        "w": rng.uniform(0.0, 50.0, count),
    }

    def one(run, row):
        return run(Gains(*row["gains"]), MOTOR | {"R": row["R"]}, row["reference"], samples=200, x0={"w": row["w"]})

    return rows, one


@pytest.mark.parametrize("stepper", ["exact", "rosenbrock"])
def test_batches_over_everything_equal_single_loops(stepper):
    loop = closed_loop(
        motor(), pid(PERIOD, lower=0.0, upper=255.0), period=PERIOD, actuator=Actuator.pwm(12.0), stepper=stepper
    )
    rows, one = batch(loop)
    many = jax.vmap(lambda row: one(loop.simulate, row))(rows)
    for n in range(7):
        alone = one(loop.simulate, {k: v[n] for k, v in rows.items()})
        np.testing.assert_allclose(many.y[n], alone.y, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(many.u[n], alone.u, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("chain", ["bare", "pwm", "very late", "slow sensor"])
@pytest.mark.further(2)
def test_metrics_without_the_trajectory_equal_those_with_it(chain):
    sensor, actuator = CHAINS[chain]
    loop = closed_loop(
        motor(),
        pid(PERIOD, lower=actuator.lower, upper=actuator.upper),
        period=PERIOD,
        sensor=sensor,
        actuator=actuator,
    )
    rows, one = batch(loop)
    observer = step_observer()
    folded = jax.vmap(lambda row: one(lambda *a, **k: loop.observe(observer, *a, **k), row))(rows)
    stored = jax.vmap(lambda row: one(loop.simulate, row))(rows)
    for n in range(7):
        expected = step_metrics(stored.t[n], stored.y[n], rows["reference"][n])
        np.testing.assert_array_equal(np.array([m[n] for m in folded]), np.array(expected))


def test_an_observer_sees_every_sample_once():
    def update(seen, t, y, u, reference):
        return seen[0] + 1, seen[1] + t, seen[2] + y, seen[3] + u, seen[4] + reference

    total = Observer(lambda y, r: (0, 0.0, 0.0, 0.0, 0.0), update, lambda seen: seen)
    loop, reference = closed_loop(motor(), pid(PERIOD), period=PERIOD), np.linspace(1.0, 90.0, 33)
    folded, stored = loop.observe(total, GAINS, MOTOR, reference), loop.simulate(GAINS, MOTOR, reference)
    assert folded[0] == 33
    np.testing.assert_allclose(
        folded[1:], [stored.t.sum(), stored.y.sum(), stored.u.sum(), reference.sum()], rtol=1e-12
    )


def test_gradients_by_gains_and_plant_equal_differences():
    loop = closed_loop(motor(), pid(PERIOD), period=PERIOD, actuator=Actuator(gain=12 / 255))

    def cost(kp, resistance):
        seen = loop.simulate(Gains(kp, 6.0, 1e-4), MOTOR | {"R": resistance}, 300.0, samples=120)
        return jnp.mean((seen.y - 300.0) ** 2)

    at = np.array([0.05, 2.76])
    compiled, slopes = jax.jit(cost), jax.jit(jax.grad(cost, argnums=(0, 1)))(*at)
    for n, slope in enumerate(slopes):
        step = 1e-4 * np.eye(2)[n]
        difference = float(compiled(*(at + step)) - compiled(*(at - step))) / 2e-4
        assert float(slope) == pytest.approx(difference, rel=1e-5)


def test_a_loop_that_diverges_is_a_value():
    loop = closed_loop(motor(), pid(PERIOD), period=PERIOD)
    m = loop.observe(step_observer(), Gains(1e4), MOTOR, 300.0, samples=800)
    assert m.settling_time == np.inf
    assert not abs(m.steady_state_error) < 1e6


def test_other_values_do_not_compile_again():
    traced = []

    def update(state, measurement, reference, gains):
        traced.append(1)
        return state, gains * (reference - measurement)

    loop = closed_loop(motor(), Controller(lambda y, p: (), update), period=PERIOD)
    loop.simulate(0.1, MOTOR, 300.0, samples=20)
    before = len(traced)
    loop.simulate(0.2, MOTOR | {"J": 3e-8}, 250.0, samples=20)
    assert len(traced) == before > 0


def test_a_controller_of_ones_own():
    relay = Controller(
        lambda y, p: jnp.asarray(0.0), lambda s, y, r, p: (s + 1.0, jnp.where(r > y, p["high"], -p["high"]))
    )
    seen = closed_loop(motor(), relay, period=PERIOD).simulate({"high": 9.0}, MOTOR, 100.0, samples=100)
    assert set(np.asarray(seen.command)) == {-9.0, 9.0}
    np.testing.assert_array_equal(np.asarray(seen.command) > 0, np.asarray(seen.measured) < 100.0)


def delayed() -> Model:
    return Model(
        name="late",
        states={"y": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("Td"),),
        derivative=lambda x, u, p: {"y": u["ud"]},
        output=lambda x, u, p: {"y": x["y"]},
        delays=(Delay("ud", "u", "Td"),),
    )


def run(**changes):
    arguments: dict[str, Any] = {"reference": 1.0, "samples": 10, "plant": MOTOR, "inputs": {"T": 0.0}} | changes
    return closed_loop(motor(load=True), pid(PERIOD), period=PERIOD, input="V").simulate(GAINS, **arguments)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: closed_loop(motor(), pid(1.0), period=0.0), "period = 0.0"),
        (lambda: closed_loop(motor(), pid(1.0), period=1.0, substeps=0), "substeps = 0"),
        (lambda: closed_loop(motor(), pid(1.0), period=1.0, stepper="euler"), "'euler' is unknown"),
        (lambda: closed_loop(tank(), pid(1.0), period=1.0, stepper="exact"), "not linear"),
        (lambda: closed_loop(motor(load=True), pid(1.0), period=1.0), "none was named"),
        (lambda: closed_loop(motor(), pid(1.0), period=1.0, output="speed"), "'speed' is not one of them"),
        (lambda: closed_loop(delayed(), pid(1.0), period=1.0), "give closed_loop a longest_delay"),
        (lambda: run(plant={"R": 1.0}), "no value for parameter 'L'"),
        (lambda: run(x0={"speed": 1.0}), "no state 'speed'"),
        (lambda: run(inputs={}), "also takes the input 'T'"),
        (lambda: run(inputs={"T": 0.0, "V": 1.0}), "inputs names 'V'"),
        (lambda: run(samples=None), "give samples = N"),
        (lambda: run(samples=0), "at least one"),
        (lambda: run(noise=np.zeros(9)), "9 values for 10 samples"),
        (lambda: run(reference=np.ones((2, 10))), "jax.vmap"),
        (lambda: Sensor(quantum=-1.0), "quantum is -1"),
        (lambda: Sensor(every=0), "every is 0"),
        (lambda: Sensor(delay=True), "delay is True"),
        (lambda: Actuator(1.0, 1.0), "lower below upper"),
        (lambda: Actuator(gain=np.inf), "gain is inf"),
        (lambda: Actuator.pwm(12.0, bits=0), "bits is 0"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()
