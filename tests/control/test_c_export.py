"""Exported C against the Python controllers that it was made from: sample by sample, and in the closed loop."""

import shutil
import subprocess
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from c_programs import REAL, ArrayProgram, PidProgram, compiled, macro
from plants import PERIOD, STICK, carts, stick, straight, upright
from test_takagi_sugeno import leaning

from plantfit.control import (
    Gains,
    design_to_c,
    kalman_observer,
    kalman_to_c,
    linearised,
    lqr,
    mpc,
    pid,
    pid_to_c,
    takagi_sugeno,
)
from plantfit.errors import SimulationError
from plantfit.simulate.closed_loop import Controller, closed_loop
from plantfit.simulate.sensors import Actuator, Sensor

import jax
import jax.numpy as jnp

H = 0.01
EPS = float(np.finfo(np.float32).eps)
GAINS = Gains(2.0, 6.0, 0.05, b=0.7, c=0.2, filter_time=0.03)
LIMITS: dict[str, Any] = {"lower": -1.5, "upper": 2.0}
KINDS: list[tuple[Gains, dict[str, Any]]] = [
    (GAINS, {}),
    (GAINS, LIMITS),
    (GAINS, LIMITS | {"anti_windup": "none"}),
    (GAINS, LIMITS | {"anti_windup": "back-calculation", "tracking_time": 0.08}),
    (Gains(-1.3, -0.4, -0.02), {"upper": 0.8}),
    (Gains(0.5), {"lower": 0.0, "upper": 1.0}),
]
IDS = ["free", "clamping", "wound up", "back-calculation", "negative", "proportional"]


def signals(n=1000, seed=5):
    """Measurement and reference (n,) that wander within +-1, with stretches of constant sign that wind an integral up."""
    rng = np.random.default_rng(seed)
    y = np.clip(np.cumsum(rng.normal(scale=0.03, size=n)), -0.5, 0.5)
    return y, np.repeat(rng.uniform(0.5, 1.0, n // 100) * (-1.0) ** np.arange(n // 100), 100)


def commands(controller, reference, measured, gains):
    """Commands (n,) of the Python controller, at rest before, at the first measurement."""

    def sample(state, both):
        return controller.update(state, both[1], both[0], gains)

    measured = jnp.asarray(measured, dtype=float)
    begun = jax.tree.map(jnp.asarray, controller.init(measured[0], gains))
    return np.asarray(jax.jit(lambda: jax.lax.scan(sample, begun, (jnp.asarray(reference, dtype=float), measured))[1])())


def exported(program, measured, reference):
    program.begin(measured[0])
    return np.array([program.update(y, r) for y, r in zip(measured, reference, strict=True)])


@pytest.mark.parametrize(("gains", "options"), KINDS, ids=IDS)
@pytest.mark.parametrize("number", ["double", "float"])
def test_a_pid_equals_its_python_to_rounding(tmp_path, number, gains, options):
    y, r = (a.astype(REAL[number]).astype(float) for a in signals())
    ours = commands(pid(H, **options), r, y, gains)
    told = exported(PidProgram(pid_to_c(gains, tmp_path, period=H, number=number, **options), number), y, r)
    scale = 1e-12 if number == "double" else 30 * EPS  # 1000 sums of an integral
    np.testing.assert_allclose(told, ours, rtol=scale, atol=scale * np.abs(ours).max())
    if options.get("upper") == 2.0 and options.get("anti_windup") != "none":
        assert np.mean(ours == 2.0) > 0.02
        assert np.mean(ours == -1.5) > 0.02


@pytest.mark.parametrize(("gains", "options"), KINDS, ids=IDS)
@pytest.mark.parametrize(("number", "bits", "full"), [("q15", 16, (1.0, 3.0)), ("q31", 32, (1.7, 40.0))])
def test_a_fixed_point_pid_stays_within_its_stated_error(tmp_path, number, bits, gains, options, full):
    files = pid_to_c(gains, tmp_path, period=H, number=number, full_scale={"measurement": full[0], "command": full[1]}, **options)
    step, unit = macro(files, "PID_MEASUREMENT_STEP"), macro(files, "PID_COMMAND_STEP")
    assert step == full[0] / 2 ** (bits - 1)
    assert unit == full[1] / 2 ** (bits - 1)
    largest = 2 ** (bits - 1) - 1
    y, r = (np.clip(np.rint(a / step), -largest - 1, largest).astype(int) for a in signals())
    held = {"lower": -full[1], "upper": largest * unit} | {k: v for k, v in options.items() if k in LIMITS}
    ours = commands(pid(H, **(options | held)), r * step, y * step, gains) / unit
    told = exported(PidProgram(files, number), y.tolist(), r.tolist())
    bound = macro(files, "PID_ERROR_BOUND")
    assert np.max(np.abs(told - ours)) <= bound
    assert bound < (1.2 if number == "q15" else 400.0)
    assert max(told) <= held["upper"] / unit
    assert min(told) >= held["lower"] / unit


def test_the_integral_of_a_fixed_point_pid_forgets_nothing(tmp_path):
    """An error of one step for long, with a gain that adds 2e-5 of a step a sample."""
    gains = Gains(0.0, 2e-5 / H)
    files = pid_to_c(gains, tmp_path, period=H, number="q15", full_scale={"measurement": 1.0, "command": 1.0})
    told = exported(PidProgram(files, "q15"), [0] * 130_000, [1] * 130_000)
    np.testing.assert_allclose(told[[24_900, 25_100, 74_900, 75_100, 124_900, 125_100]], [0, 1, 1, 2, 2, 3])


@pytest.mark.parametrize("number", ["q15", "q31"])
def test_a_fixed_point_pid_does_not_wrap_at_the_ends_of_its_range(tmp_path, number):
    """Signals jump between the most negative and most positive whole number, with the largest gains that are accepted."""
    bits = 16 if number == "q15" else 32
    most, gains = 2 ** (bits - 1) - 1, Gains(900.0, 4e3, 6.0, filter_time=0.01)
    files = pid_to_c(gains, tmp_path, period=H, number=number, full_scale={"measurement": 1.0, "command": 1.0})
    rng = np.random.default_rng(1)
    y, r = (np.where(rng.random(4000) < 0.5, -most - 1, most) for _ in range(2))
    unit = 2.0 ** (1 - bits)
    ours = commands(pid(H, lower=-1.0, upper=most * unit), r * unit, y * unit, gains) / unit
    told = exported(PidProgram(files, number), y.tolist(), r.tolist())
    assert np.max(np.abs(told - ours)) <= macro(files, "PID_ERROR_BOUND")
    assert set(told) >= {-most - 1, most}


def in_loop(begin, update, size):
    """A program as a `Controller`: its struct travels as bytes, so that it stays a pure function for the loop."""
    struct = jax.ShapeDtypeStruct((size,), jnp.uint8)

    def init(measurement, parameters):
        return jax.pure_callback(begin, struct, measurement)

    def stepped(state, measurement, reference, parameters):
        return jax.pure_callback(update, (struct, jax.ShapeDtypeStruct((), jnp.float64)), state, measurement, reference)

    return Controller(init, stepped)


@pytest.mark.parametrize("number", ["double", "q15"])
def test_a_pid_in_the_closed_loop_equals_the_python_loop(tmp_path, number):
    plant, n = straight(), 300
    values, gains = STICK | {"a": -20.0, "c": 2.0}, Gains(0.6, 1.5, 0.08, filter_time=0.02)
    full = {"measurement": 1.0, "command": 1.0}
    files = pid_to_c(gains, tmp_path, period=H, lower=-0.3, upper=0.3, number=number, full_scale=full if number == "q15" else None)
    program, step = PidProgram(files, number), 1.0 if number == "double" else 2.0**-15

    def counts(value):
        return float(value) if number == "double" else round(float(value) / step)

    def begin(measurement):
        program.begin(counts(measurement))
        return np.frombuffer(program.state, np.uint8)

    def update(state, measurement, reference):
        program.state[:] = bytes(np.asarray(state))
        command = program.update(counts(measurement), counts(reference))
        return np.frombuffer(program.state, np.uint8), np.float64(step * command)

    sensor, wanted = Sensor(quantum=2.0**-15), np.where(np.arange(n) < 150, 0.25, -0.125)
    runs = []
    for controller in (pid(H, lower=-0.3, upper=0.3), in_loop(begin, update, len(program.state))):
        loop = closed_loop(plant, controller, period=H, sensor=sensor, actuator=Actuator(-0.3, 0.3), stepper="exact")
        runs.append(loop.simulate(gains, values, wanted))
    assert np.mean(np.abs(np.asarray(runs[0].u)) == 0.3) > 0.02
    if number == "double":
        np.testing.assert_allclose(runs[1].u, runs[0].u, rtol=1e-12, atol=1e-12)
    else:  # the derivative carries a step of the sensor, seen sooner or later, to the command
        np.testing.assert_allclose(runs[1].y, runs[0].y, atol=4 * step)
        np.testing.assert_allclose(runs[1].u, runs[0].u, atol=2 * step * 0.08 / 0.03 + step * 4)


def carried(number, design, measured, states, inputs):
    """Commands (n, m) in the order of the inputs by the Python design, and those of the exported one."""
    plant = design.plant
    first = dict(zip(plant.outputs, measured[0], strict=True))
    state, ours = jax.jit(design.controller.init)(first, design.parameters), []
    update = jax.jit(design.controller.update)
    for y, x, u in zip(measured, states, inputs, strict=True):
        reference = dict(zip(plant.states, x, strict=True)) | dict(zip(plant.inputs, u, strict=True))
        state, command = update(state, dict(zip(plant.outputs, y, strict=True)), reference, design.parameters)
        ours.append([float(command[name]) for name in plant.inputs])
    return np.array(ours)


def played(program, n_inputs, measured, states=None, inputs=None):
    program.call("init", measured[0])
    told, command = [], np.zeros(n_inputs, program.kind)
    for k, y in enumerate(measured):
        program.call("update", y, None if states is None else states[k], None if inputs is None else inputs[k], command)
        told.append(command.copy())
    return np.array(told)


def cart_design():
    plant = linearised(carts(), {"k": 3.0, "c": 0.4}, {"q": 0.3, "s": 0.3})
    estimator = kalman_observer(plant, PERIOD, {"v": 0.3, "w": 0.1}, {"s": 1e-2, "q": 2e-2})
    return lqr(plant, PERIOD, {"q": 4.0, "v": 1.0, "s": 1.0}, {"F": 0.2, "G": 0.5}, estimator=estimator, limits={"F": (-0.4, 0.5)})


def blended_design():
    plants = [leaning(q, ("q", "w")) for q in (-1.2, 0.0, 1.2)]
    filters = [kalman_observer(p, PERIOD, {"w": 0.3}, {"q": 1e-3, "w": 1e-2}) for p in plants]
    weights = ({"q": 1.0}, {"u": 0.2})
    return takagi_sugeno(plants, PERIOD, *weights, premise="q", hold=1, estimators=filters, limits=(-0.5, 0.6))


DESIGNS = {
    "filter": cart_design,
    "states measured": lambda: lqr(upright(("q", "w")), PERIOD, 1.0, 1.0, limits=(-0.2, 0.3)),
    "blended": blended_design,
}


@pytest.mark.parametrize("which", DESIGNS)
@pytest.mark.parametrize("number", ["double", "float"])
def test_a_design_equals_its_python_to_rounding(tmp_path, number, which):
    design, rng, n = DESIGNS[which](), np.random.default_rng(2), 250
    p, s, m = (len(names) for names in (design.plant.outputs, design.plant.states, design.plant.inputs))
    wander = np.sin(np.arange(n)[:, None] / [17.0, 23.0, 31.0, 12.0])
    measured = (1.5 * wander[:, :p] + 0.02 * rng.normal(size=(n, p))).astype(REAL[number]).astype(float)
    states, inputs = ((0.3 * np.roll(wander, 40, 0)[:, :k]).astype(REAL[number]).astype(float) for k in (s, m))
    ours = carried(number, design, measured, states, inputs)
    program = ArrayProgram(design_to_c(design, tmp_path, name="held", number=number), number)
    told = played(program, m, measured, states, inputs)
    # sums of a few products of gain and state, carried through the filter
    scale = 1e-12 if number == "double" else 50 * EPS
    size = np.abs(np.asarray(design.parameters.gain if which != "blended" else design.parameters.gains)).sum(-1).max() * 2.0
    np.testing.assert_allclose(told, ours, rtol=scale, atol=scale * size)
    low, high = np.asarray(design.parameters.lower), np.asarray(design.parameters.upper)
    assert np.any(ours == low)
    assert np.any(ours == high)
    rest = carried(number, design, measured, np.tile(design.plant.x0, (n, 1)), np.tile(design.plant.u0, (n, 1)))
    np.testing.assert_allclose(played(program, m, measured), rest, rtol=scale, atol=scale * size)


def test_a_regulator_in_the_closed_loop_equals_the_python_loop(tmp_path):
    """The unstable stick, its angle measured in steps, held by the exported filter and gain."""
    design = lqr(upright(), PERIOD, 1.0, 0.1, estimator=kalman_observer(upright(), PERIOD, {"w": 0.5}, 1e-3), limits=(-0.08, 0.08))
    program = ArrayProgram(design_to_c(design, tmp_path, name="stick"), "double")

    def begin(measurement):
        program.call("init", np.array([float(measurement)]))
        return np.frombuffer(program.state, np.uint8)

    def update(state, measurement, reference):
        command = np.zeros(1)
        program.state[:] = bytes(np.asarray(state))
        program.call("update", np.array([float(measurement)]), np.array([float(reference), 0.0]), None, command)
        return np.frombuffer(program.state, np.uint8), np.float64(command[0])

    wanted = np.where(np.arange(200) < 120, 0.05, -0.02)
    options = {"sensor": Sensor(quantum=1e-3), "actuator": Actuator(-0.08, 0.08), "stepper": "rk4"}
    noise = 1e-3 * np.random.default_rng(4).normal(size=200)
    ours = design.close(stick(), **options).simulate(design.parameters, STICK, {"q": wanted}, x0={"q": 0.1}, noise={"q": noise})
    other = closed_loop(stick(), in_loop(begin, update, len(program.state)), period=PERIOD, **options)
    told = other.simulate(None, STICK, wanted, x0={"q": 0.1}, noise=noise)
    assert np.any(np.abs(np.asarray(ours.u["u"])) == 0.08)
    np.testing.assert_allclose(told.u, ours.u["u"], rtol=1e-9, atol=1e-12)
    assert np.max(np.abs(np.asarray(told.y))) < 0.12


@pytest.mark.parametrize("number", ["double", "float"])
def test_a_kalman_filter_equals_its_python_to_rounding(tmp_path, number):
    for case, through in (("plain", 0.0), ("through", 0.3)):
        plant = replace(cart_design().plant, D=through * np.ones((2, 2)))
        estimator = kalman_observer(plant, PERIOD, {"v": 0.3, "w": 0.1}, {"s": 1e-2, "q": 2e-2})
        program = ArrayProgram(kalman_to_c(estimator, plant, PERIOD, tmp_path, name=f"seen_{case}", number=number), number)
        rng = np.random.default_rng(6)
        y, u = (np.cumsum(rng.normal(scale=0.05, size=(200, 2)), 0).astype(REAL[number]).astype(float) for _ in range(2))
        x, last = estimator.begin(jnp.asarray(y[0])), np.zeros(2)
        program.call("init", y[0])
        scale = 1e-12 if number == "double" else 50 * EPS
        for k in range(200):
            x = estimator.corrected(x, y[k], last)
            program.call("correct", y[k], last)
            np.testing.assert_allclose(program.states(4), x, rtol=scale, atol=scale * 5.0)
            x, last = estimator.predicted(x, u[k]), u[k]
            program.call("predict", last)
            np.testing.assert_allclose(program.states(4), x, rtol=scale, atol=scale * 5.0)


@pytest.mark.parametrize("compiler", ["arm-none-eabi-gcc", "avr-gcc"])
def test_the_same_files_compile_for_small_processors(tmp_path, compiler):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not on this machine: the exported C is not compiled for that processor")
    made = [pid_to_c(GAINS, tmp_path, period=H, **LIMITS, name="speed_float", number="float")]
    made += [pid_to_c(GAINS, tmp_path, period=H, **LIMITS, name="speed_q15", number="q15", full_scale={"measurement": 1.0, "command": 2.0})]
    made += [design_to_c(cart_design(), tmp_path, name="carts", number="float")]
    for files in made:
        flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Os", "-c"]
        subprocess.run([compiler, *flags, "-o", tmp_path / "one.o", files.source], check=True, timeout=60)


def test_the_header_tells_units_period_and_what_it_was_designed_on(tmp_path):
    header = design_to_c(cart_design(), tmp_path, name="carts", note="Fitted on day 3. */ int x;").header.read_text()
    assert "Every 0.02 s" in header
    assert "outputs [0] s [-] = 0.3, [1] q [-] = 0.3." in header
    assert "Commands limited to [-0.4, 0.5], [-inf, inf]." in header
    assert "Fitted on day 3. * / int x;" in header
    units = {"measurement": "rad/s", "command": "V"}
    told = pid_to_c(GAINS, tmp_path, period=H, **LIMITS, units=units)
    assert "measurement and reference in rad/s, command in V" in told.header.read_text()
    compiled(told)


FULL = {"measurement": 1.0, "command": 1.0}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda at: pid_to_c(GAINS, at, period=0.0), "period"),
        (lambda at: pid_to_c(GAINS, at, period=H, name="2nd"), "name = '2nd'"),
        (lambda at: pid_to_c(GAINS, at, period=H, name="double"), "no word of C"),
        (lambda at: pid_to_c(GAINS, at, period=H, number="q7"), "'double', 'float', 'q15', 'q31'"),
        (lambda at: pid_to_c(GAINS, at, period=H, number="q15"), "full_scale = None"),
        (lambda at: pid_to_c(GAINS, at, period=H, number="q15", full_scale=FULL | {"command": 0.0}), "of the command is 0"),
        (lambda at: pid_to_c(GAINS, at, period=H, number="q15", full_scale=FULL, upper=2.0), "larger full scale"),
        (lambda at: pid_to_c(GAINS, at, period=H, full_scale=FULL), "belongs to fixed point"),
        (lambda at: pid_to_c(Gains(1e5), at, period=H, number="q15", full_scale=FULL), "Kp moves the command by 1e"),
        (lambda at: pid_to_c(Gains(7e3, 0.0, 80.0), at, period=H, number="q31", full_scale=FULL), "times its full scale"),
        (lambda at: pid_to_c(Gains(1.0, 1e-30), at, period=H, number="q15", full_scale=FULL), "Ki is too small"),
        (lambda at: pid_to_c(Gains(1.0, 1.0, 1.0, filter_time=1e9), at, period=H, number="q15", full_scale=FULL), "1e9 periods"),
        (lambda at: pid_to_c(Gains(float("nan")), at, period=H), "Kp = nan"),
        (lambda at: pid_to_c(Gains(1e39), at, period=H, number="float"), "not finite in 'float'"),
        (lambda at: pid_to_c(GAINS._replace(filter_time=-1.0), at, period=H), "filter_time = -1"),
        (lambda at: pid_to_c(GAINS, at, period=H, units={"speed": "rad/s"}), "units names 'speed'"),
        (lambda at: pid_to_c(GAINS, at / "nowhere", period=H), "folder that exists"),
        (lambda at: design_to_c(cart_design(), at, name="a", number="q15"), "'double', 'float'"),
        (lambda at: design_to_c(mpc(upright(("q", "w")), PERIOD, 1.0, 1.0, limits=None, horizon=3), at, name="a"), "pid_to_c"),
        (lambda at: kalman_to_c(cart_design().parameters.estimator, upright(), PERIOD, at), "for this plant"),
        (lambda at: kalman_to_c(cart_design().parameters.estimator, cart_design().plant, -1.0, at), "period = -1"),
    ],
)
def test_bad_input_is_named(tmp_path, call, words):
    with pytest.raises(SimulationError, match=words):
        call(tmp_path)
    assert not list(tmp_path.iterdir())
