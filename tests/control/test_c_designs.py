"""State feedback and Kalman filters exported as C against their Python: sample by sample, and in the closed loop."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from c_programs import REAL, ArrayProgram, in_loop
from plants import PERIOD, STICK, carts, stick, upright
from test_takagi_sugeno import leaning

from plantfit.control import (
    Gains,
    design_to_c,
    kalman_observer,
    kalman_to_c,
    linearised,
    lqr,
    mpc,
    pid_to_c,
    takagi_sugeno,
)
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

import jax
import jax.numpy as jnp

EPS = float(np.finfo(np.float32).eps)


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
    return lqr(
        plant,
        PERIOD,
        {"q": 4.0, "v": 1.0, "s": 1.0},
        {"F": 0.2, "G": 0.5},
        estimator=estimator,
        limits={"F": (-0.4, 0.5)},
    )


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
@pytest.mark.further(4)
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
    size = (
        np.abs(np.asarray(design.parameters.gain if which != "blended" else design.parameters.gains)).sum(-1).max()
        * 2.0
    )
    np.testing.assert_allclose(told, ours, rtol=scale, atol=scale * size)
    low, high = np.asarray(design.parameters.lower), np.asarray(design.parameters.upper)
    assert np.any(ours == low)
    assert np.any(ours == high)
    rest = carried(number, design, measured, np.tile(design.plant.x0, (n, 1)), np.tile(design.plant.u0, (n, 1)))
    np.testing.assert_allclose(played(program, m, measured), rest, rtol=scale, atol=scale * size)


def test_a_regulator_in_the_closed_loop_equals_the_python_loop(tmp_path):
    """The unstable stick, its angle measured in steps, held by the exported filter and gain."""
    design = lqr(
        upright(),
        PERIOD,
        1.0,
        0.1,
        estimator=kalman_observer(upright(), PERIOD, {"w": 0.5}, 1e-3),
        limits=(-0.08, 0.08),
    )
    program = ArrayProgram(design_to_c(design, tmp_path, name="stick"), "double")

    def begin(measurement):
        program.call("init", np.array([float(measurement)]))
        return np.frombuffer(program.state.raw, np.uint8)

    def update(state, measurement, reference):
        command = np.zeros(1)
        program.state.raw = bytes(np.asarray(state))
        program.call("update", np.array([float(measurement)]), np.array([float(reference), 0.0]), None, command)
        return np.frombuffer(program.state.raw, np.uint8), np.float64(command[0])

    wanted = np.where(np.arange(200) < 120, 0.05, -0.02)
    options = {"sensor": Sensor(quantum=1e-3), "actuator": Actuator(-0.08, 0.08), "stepper": "rk4"}
    noise = 1e-3 * np.random.default_rng(4).normal(size=200)
    ours = design.close(stick(), **options).simulate(
        design.parameters, STICK, {"q": wanted}, x0={"q": 0.1}, noise={"q": noise}
    )
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
        program = ArrayProgram(
            kalman_to_c(estimator, plant, PERIOD, tmp_path, name=f"seen_{case}", number=number), number
        )
        rng = np.random.default_rng(6)
        y, u = (
            np.cumsum(rng.normal(scale=0.05, size=(200, 2)), 0).astype(REAL[number]).astype(float) for _ in range(2)
        )
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
    gains = Gains(2.0, 6.0, 0.05, filter_time=0.03)
    made = [pid_to_c(gains, tmp_path, period=0.01, upper=1.0, name="speed_float", number="float")]
    made += [
        pid_to_c(
            gains,
            tmp_path,
            period=0.01,
            upper=1.0,
            name="speed_q15",
            number="q15",
            full_scale={"measurement": 1.0, "command": 2.0},
        )
    ]
    made += [design_to_c(cart_design(), tmp_path, name="carts", number="float")]
    for files in made:
        flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Os", "-c"]
        subprocess.run([compiler, *flags, "-o", tmp_path / "one.o", files.source], check=True, timeout=600)


def test_the_header_tells_units_period_and_what_it_was_designed_on(tmp_path):
    header = design_to_c(cart_design(), tmp_path, name="carts", note="Fitted on day 3. */ int x;").header.read_text()
    assert "Every 0.02 s" in header
    assert "outputs [0] s [-] = 0.3, [1] q [-] = 0.3." in header
    assert "Commands limited to [-0.4, 0.5], [-inf, inf]." in header
    assert "Fitted on day 3. * / int x;" in header


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda at: design_to_c(cart_design(), at, name="a", number="q15"), "'double', 'float'"),
        (
            lambda at: design_to_c(mpc(upright(("q", "w")), PERIOD, 1.0, 1.0, limits=None, horizon=3), at, name="a"),
            "pid_to_c",
        ),
        (lambda at: kalman_to_c(cart_design().parameters.estimator, upright(), PERIOD, at), "for this plant"),
        (lambda at: kalman_to_c(cart_design().parameters.estimator, cart_design().plant, -1.0, at), "period = -1"),
    ],
)
def test_bad_input_is_named(tmp_path, call, words):
    with pytest.raises(SimulationError, match=words):
        call(tmp_path)
    assert not list(tmp_path.iterdir())
