"""The PID exported as C against its Python: sample by sample, at the ends of its range, and in the closed loop."""

from typing import Any

import numpy as np
import pytest
from c_programs import REAL, PidProgram, compiled, in_loop, macro
from plants import STICK, straight

from plantfit.control import Gains, pid, pid_to_c
from plantfit.errors import SimulationError
from plantfit.simulate.loop.closed_loop import closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

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
    (Gains(2.0, 6.0, 0.3), LIMITS),
    (Gains(-1.3, -0.4, -0.02), {"upper": 0.8}),
    (Gains(0.5), {"lower": 0.0, "upper": 1.0}),
]
IDS = ["free", "clamping", "wound up", "back-calculation", "kicked", "negative", "proportional"]


def signals(n=1000, seed=5):
    """Measurement and reference (n,) that wander within +-1, with stretches of constant sign that wind an integral
    up."""
    rng = np.random.default_rng(seed)
    y = np.clip(np.cumsum(rng.normal(scale=0.03, size=n)), -0.5, 0.5)
    return y, np.repeat(rng.uniform(0.5, 1.0, n // 100) * (-1.0) ** np.arange(n // 100), 100)


def commands(controller, reference, measured, gains, rest=0.0):
    """Commands (n,) of the Python controller, at rest before, at the first measurement with the command `rest`."""

    def sample(state, both):
        return controller.update(state, both[1], both[0], gains)

    measured = jnp.asarray(measured, dtype=float)
    begun = jax.tree.map(jnp.asarray, controller.init(measured[0], gains).at_rest(measured[0], rest, gains))
    return np.asarray(
        jax.jit(lambda: jax.lax.scan(sample, begun, (jnp.asarray(reference, dtype=float), measured))[1])()
    )


def exported(program, measured, reference, rest: float = 0):
    program.begin(measured[0], rest)
    return np.array([program.update(y, r) for y, r in zip(measured, reference, strict=True)])


@pytest.mark.parametrize(("gains", "options"), KINDS, ids=IDS)
@pytest.mark.parametrize("number", ["double", "float"])
def test_a_pid_equals_its_python_to_rounding(tmp_path, number, gains, options):
    y, r = (a.astype(REAL[number]).astype(float) for a in signals())
    ours = commands(pid(H, **options), r, y, gains, 0.25)
    told = exported(PidProgram(pid_to_c(gains, tmp_path, period=H, number=number, **options), number), y, r, 0.25)
    scale = 1e-12 if number == "double" else 30 * EPS  # 1000 sums of an integral
    np.testing.assert_allclose(told, ours, rtol=scale, atol=scale * np.abs(ours).max())
    if options.get("upper") == 2.0 and options.get("anti_windup") != "none":
        assert np.mean(ours == 2.0) > 0.02
        assert np.mean(ours == -1.5) > 0.02


@pytest.mark.parametrize(("gains", "options"), KINDS, ids=IDS)
@pytest.mark.parametrize(("number", "bits", "full"), [("q15", 16, (1.0, 3.0)), ("q31", 32, (1.7, 40.0))])
def test_a_fixed_point_pid_stays_within_its_stated_error(tmp_path, number, bits, gains, options, full):
    files = pid_to_c(
        gains, tmp_path, period=H, number=number, full_scale={"measurement": full[0], "command": full[1]}, **options
    )
    step, unit = macro(files, "PID_MEASUREMENT_STEP"), macro(files, "PID_COMMAND_STEP")
    assert step == full[0] / 2 ** (bits - 1)
    assert unit == full[1] / 2 ** (bits - 1)
    largest = 2 ** (bits - 1) - 1
    y, r = (np.clip(np.rint(a / step), -largest - 1, largest).astype(int) for a in signals())
    held = {"lower": -full[1], "upper": largest * unit} | {k: v for k, v in options.items() if k in LIMITS}
    rest = round(0.25 / unit)
    ours = commands(pid(H, **(options | held)), r * step, y * step, gains, rest * unit) / unit
    told = exported(PidProgram(files, number), y.tolist(), r.tolist(), rest)
    bound = macro(files, "PID_ERROR_BOUND")
    assert np.max(np.abs(told - ours)) <= bound
    assert bound < (1.2 if number == "q15" else 400.0)
    assert max(told) <= held["upper"] / unit
    assert min(told) >= held["lower"] / unit


@pytest.mark.parametrize(("gains", "options"), KINDS, ids=IDS)
@pytest.mark.parametrize("number", ["double", "float", "q15", "q31"])
def test_a_pid_begins_at_the_command_that_holds_the_plant(tmp_path, number, gains, options):
    full = {"measurement": 1.0, "command": 4.0} if number[0] == "q" else None
    files = pid_to_c(gains, tmp_path, period=H, number=number, full_scale=full, **options)
    step = macro(files, "PID_MEASUREMENT_STEP") if full else 1.0
    unit = macro(files, "PID_COMMAND_STEP") if full else 1.0
    y, rest = (0.75 / step, 0.5 / unit) if full is None else (round(0.75 / step), round(0.5 / unit))
    told = unit * np.array(exported(PidProgram(files, number), [y] * 50, [y] * 50, rest))
    np.testing.assert_allclose(told, 0.5, rtol=1e-15 if number != "float" else 2 * EPS)
    assert "the command at which the plant rests there" in files.header.read_text()


def test_the_integral_of_a_fixed_point_pid_forgets_nothing(tmp_path):
    """An error of one step for long, with a gain that adds 2e-5 of a step a sample."""
    gains = Gains(0.0, 2e-5 / H)
    files = pid_to_c(gains, tmp_path, period=H, number="q15", full_scale={"measurement": 1.0, "command": 1.0})
    told = exported(PidProgram(files, "q15"), [0] * 130_000, [1] * 130_000)
    np.testing.assert_allclose(told[[24_900, 25_100, 74_900, 75_100, 124_900, 125_100]], [0, 1, 1, 2, 2, 3])


@pytest.mark.parametrize("number", ["q15", "q31"])
def test_a_fixed_point_pid_does_not_wrap_at_the_ends_of_its_range(tmp_path, number):
    """Signals jump between the most negative and most positive whole number, with the largest gains that are
    accepted."""
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


@pytest.mark.parametrize("number", ["double", "q15"])
def test_a_pid_in_the_closed_loop_equals_the_python_loop(tmp_path, number):
    plant, n = straight(), 300
    values, gains = STICK | {"a": -20.0, "c": 2.0}, Gains(0.6, 1.5, 0.08, filter_time=0.02)
    full = {"measurement": 1.0, "command": 1.0}
    files = pid_to_c(
        gains, tmp_path, period=H, lower=-0.3, upper=0.3, number=number, full_scale=full if number == "q15" else None
    )
    program, step = PidProgram(files, number), 1.0 if number == "double" else 2.0**-15

    def counts(value):
        return float(value) if number == "double" else round(float(value) / step)

    def begin(measurement):
        program.begin(counts(measurement))
        return np.frombuffer(program.state.raw, np.uint8)

    def update(state, measurement, reference):
        program.state.raw = bytes(np.asarray(state))
        command = program.update(counts(measurement), counts(reference))
        return np.frombuffer(program.state.raw, np.uint8), np.float64(step * command)

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


def test_the_header_tells_units(tmp_path):
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
        (
            lambda at: pid_to_c(GAINS, at, period=H, number="q15", full_scale=FULL | {"command": 0.0}),
            "of the command is 0",
        ),
        (lambda at: pid_to_c(GAINS, at, period=H, number="q15", full_scale=FULL, upper=2.0), "larger full scale"),
        (lambda at: pid_to_c(GAINS, at, period=H, full_scale=FULL), "belongs to fixed point"),
        (lambda at: pid_to_c(Gains(1e5), at, period=H, number="q15", full_scale=FULL), "Kp moves the command by 1e"),
        (
            lambda at: pid_to_c(Gains(7e3, 0.0, 80.0), at, period=H, number="q31", full_scale=FULL),
            "times its full scale",
        ),
        (lambda at: pid_to_c(Gains(1.0, 1e-30), at, period=H, number="q15", full_scale=FULL), "Ki is too small"),
        (
            lambda at: pid_to_c(Gains(1.0, 1.0, 1.0, filter_time=1e9), at, period=H, number="q15", full_scale=FULL),
            "1e9 periods",
        ),
        (lambda at: pid_to_c(Gains(float("nan")), at, period=H), "Kp = nan"),
        (lambda at: pid_to_c(Gains(1e39), at, period=H, number="float"), "not finite in 'float'"),
        (lambda at: pid_to_c(GAINS._replace(filter_time=-1.0), at, period=H), "filter_time = -1"),
        (lambda at: pid_to_c(GAINS, at, period=H, units={"speed": "rad/s"}), "units names 'speed'"),
        (lambda at: pid_to_c(GAINS, at / "nowhere", period=H), "folder that exists"),
    ],
)
def test_bad_input_is_named(tmp_path, call, words):
    with pytest.raises(SimulationError, match=words):
        call(tmp_path)
    assert not list(tmp_path.iterdir())
