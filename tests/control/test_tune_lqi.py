"""LQ servos with dead time: gains by a full Riccati equation, responses by sums of what the controller does, loops,
C, the search."""

from dataclasses import replace

import numpy as np
import pytest
from c_programs import PidProgram
from test_tune_pid import LAG, WISHES, family

import plantfit.runtime  # noqa: F401
from plantfit.control.c_export import servo_to_c
from plantfit.control.linear.doubling import doubled
from plantfit.control.linear.riccati import filter_gain, regulator_gain
from plantfit.control.linear.servo import Servo, servo, servo_response, unstable_poles
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.forms.servo_forms import lqi_form
from plantfit.control.tune.frequency import frequencies, input_matrices, margins, sampled_response
from plantfit.control.tune.loop_scores import Judge, from_rest
from plantfit.control.tune.reduction import reduced
from plantfit.control.tune.searching.judged import judged_on
from plantfit.control.tune.told import table, verdict
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import PidLoop, ServoLoop
from plantfit.models.text.equations import equations

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

ASKED = replace(WISHES, controller="lqi")
TWO_WAYS = equations(
    "a' = (K*delay(u, L) - a)/t1\nb' = (a + u - b)/t2\nz = b", inputs=["u"], states=["a", "b"], outputs=["z"],
    parameters=["K", "t1", "t2", "L"], name="two ways",
)  # fmt: skip
SECOND = equations(
    "a' = (K*delay(u, L) - a)/t1\nb' = (a - b)/t2\nz = b", inputs=["u"], states=["a", "b"], outputs=["z"],
    parameters=["K", "t1", "t2", "L"], name="second",
)  # fmt: skip


def rest_of(model, **parameters):
    return OneLoop(model, "z", "u", {}, {n: np.array([v]) for n, v in parameters.items()}).at_rest(
        5.0, (-10.0, 0.0, 10.0)
    )


def plant_of(rest, wishes=ASKED):
    return ServoPlant.of(rest, reduced(rest, 0.5 * wishes.period), wishes)


RESTS = {
    "lag": lambda: rest_of(LAG, K=2.0, tau=10.0, L=2.2, c=1.0),
    "no dead time": lambda: rest_of(SECOND, K=2.0, t1=4.0, t2=3.0, L=0.0),
    "second": lambda: rest_of(SECOND, K=-2.0, t1=4.0, t2=3.0, L=1.7),
    "two ways": lambda: rest_of(TWO_WAYS, K=2.0, t1=4.0, t2=3.0, L=1.7),
}


@pytest.mark.parametrize("n", [1, 4])
def test_doubling_solves_the_riccati_equation_of_scipy(n):
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(n, n)), rng.normal(size=(n, 2))
    weights = np.eye(n), np.diag([0.1, 3.0])
    truth = regulator_gain(a, b, *weights)
    assert truth is not None
    for ours, theirs in zip(doubled(a, b, *weights), truth, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("which", RESTS)
@pytest.mark.further(3)
def test_the_gains_are_those_of_all_delay_states_at_once(which):
    """The Riccati equation of plant and every past input by scipy, and that of the filter on states and load."""
    rest, rho = RESTS[which](), 0.3
    plant = plant_of(rest)
    found = plant.servo(rho, 10.0, 2.0, 3.0)
    a, b = input_matrices(rest, 0.5)
    n, past = a.shape[0], len(b) - 1
    whole, drive = np.zeros((n + past,) * 2), np.zeros((n + past, 1))
    whole[:n, :n], drive[:n, 0] = a, b[0]
    whole[:n, n:] = b[1:].T
    whole[n + 1 :, n : n + past - 1] = np.eye(max(past - 1, 0))
    if past:
        drive[n] = 1.0
    seen = np.r_[rest.C[0], np.zeros(past)]
    gain = regulator_gain(whole, drive, np.outer(seen, seen) / 4.0, np.array([[rho / plant.u_size**2]]))
    assert gain is not None
    gain = gain[0][0]
    np.testing.assert_allclose(np.r_[found.K[:n], found.P], gain, rtol=1e-7, atol=1e-9)
    assert found.K[n] == pytest.approx(1.0 + np.sum(gain[n:]))
    wide = np.block([[a, b.sum(0)[:, None]], [np.zeros((1, n)), np.ones((1, 1))]])
    own = filter_gain(wide, np.c_[rest.C, [[0.0]]], plant.wander * 100.0 + plant.shake * 4.0, np.array([[4.0]]))
    assert own is not None
    np.testing.assert_allclose(found.gain, own[:, 0], rtol=1e-7)


@pytest.mark.parametrize("which", ["no dead time", "two ways"])
@pytest.mark.thorough
def test_response_and_poles_are_those_of_what_the_controller_does(which):
    """The z-transform of its answer to an impulse, on a circle where it converges; its poles by exact derivatives of
    its update."""
    given = plant_of(RESTS[which]()).servo(0.3, 10.0, 2.0, 3.0)
    loop, h = servo(0.5), 0.5
    state = loop.init(jnp.asarray(5.0), (given, given.u0))
    y = 5.0 + np.r_[1.0, np.zeros(399)]
    _, u = jax.lax.scan(lambda s, v: loop.update(s, v, 5.0, (given, given.u0)), state, jnp.asarray(y))
    angles = np.array([0.1, 0.7, 2.0])
    z = 1.2 * np.exp(1j * angles)
    truth = -np.sum((np.asarray(u) - float(given.u0))[:, None] * z[None, :] ** -np.arange(400)[:, None], axis=0)
    np.testing.assert_allclose(servo_response(given, h, (angles - 1j * np.log(1.2)) / h), truth, rtol=1e-7)
    flat, back = ravel_pytree(state)
    moved = jax.jacfwd(lambda s: ravel_pytree(loop.update(back(s), 5.0, 5.0, (given, given.u0))[0])[0])(flat)
    sizes = np.abs(np.linalg.eigvals(moved))
    assert unstable_poles(given) == np.sum(sizes > 1.0 + 1e-6)
    assert np.min(np.abs(sizes - 1.0)) < 1e-6  # its integral action


def test_a_loop_with_an_unstable_controller_is_counted_right():
    """k/(z - 1.2) closes to the pole 1.2 - k; with an integrator to the roots of (z - 1)(z - 1.2) + k (z - 0.9)."""
    w = np.geomspace(1e-4, np.pi, 2000)
    z = np.exp(1j * w)
    for k in (0.1, 0.3, 2.0, 2.5):
        found = margins((k / (z - 1.2))[None, :], w, 0, 1)
        assert bool(found.stable[0]) == (abs(1.2 - k) < 1)
        poles = np.roots(np.polyadd([1.0, -2.2, 1.2], [k, -0.9 * k]))
        found = margins((k * (z - 0.9) / ((z - 1) * (z - 1.2)))[None, :], w, 1, 1)
        assert bool(found.stable[0]) == bool(np.all(np.abs(poles) < 1))


@pytest.mark.parametrize("which", ["no dead time", "two ways"])
def test_it_begins_at_rest_whatever_input_holds_the_true_plant(which):
    given, loop = plant_of(RESTS[which]()).servo(0.3, 10.0, 2.0, 3.0), servo(0.5, lower=-10.0, upper=10.0)
    state = loop.init(jnp.asarray(3.0), (given, 7.5))
    for _ in range(3):
        state, command = loop.update(state, 3.0, 3.0, (given, 7.5))
        assert float(command) == pytest.approx(7.5, abs=1e-9)


def test_the_output_comes_to_the_set_point_on_a_plant_of_another_gain_under_a_load():
    given, loop = plant_of(RESTS["lag"]()).servo(0.3, 10.0, 2.0, 3.0), servo(0.5, lower=-10.0, upper=10.0)
    a, b, level, past = float(given.A[0, 0]), np.asarray(given.B)[0], 1.0, [1.0] * 6
    state, update = loop.init(jnp.asarray(6.0), (given, 3.0)), jax.jit(loop.update)
    for _ in range(400):
        state, command = update(state, 5.0 + level, 5.5, (given, 3.0))
        past = [float(command) - 2.0, *past[:-1]]
        # 30 % more gain, a load of 0.3
        level = a * level + 1.3 * float(b @ np.array(past[: len(b)])) + 0.3 * float(np.sum(b))
    assert 5.0 + level == pytest.approx(5.5, abs=1e-6)


@pytest.mark.parametrize("which", ["two ways", "no dead time", "lag"])
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, which):
    given = jax.tree.map(np.asarray, plant_of(RESTS[which]()).servo(0.1, 10.0, 2.0, 3.0))
    rng = np.random.default_rng(1)
    r = 5 + 0.4 * (np.arange(10_000) // 700 % 2)
    y = r + 0.3 * np.sin(np.arange(10_000) / 37.0) + rng.normal(0, 0.1, 10_000)
    loop = servo(0.5, lower=1.8, upper=3.0)
    _, truth = jax.lax.scan(lambda s, v: loop.update(s, v[0], v[1], (given, 2.0)),
                            loop.init(jnp.asarray(y[0]), (given, 2.0)),
                            (jnp.asarray(y), jnp.asarray(r)))  # fmt: skip
    program = ServoProgram(servo_to_c(given, tmp_path, period=0.5, lower=1.8, upper=3.0, name="level"))
    program.begin(y[0], 2.0)
    told = np.array([program.update(a, b) for a, b in zip(y, r, strict=True)])
    assert (told.min(), told.max()) == (1.8, 3.0)
    assert np.mean((told > 1.8) & (told < 3.0)) > 0.1
    np.testing.assert_allclose(told, np.asarray(truth), rtol=1e-12, atol=3e-12)


class ServoProgram(PidProgram):
    """An LQ servo as exported: `begin(measurement, command)`."""

    def __init__(self, files):
        super().__init__(files, "double")


@pytest.fixture(scope="module")  # of slow tests: four searches are compiled
def design():
    return tuned_loop(family(20, 1), family(60, 2), ASKED, budget=60, seed=3)


@pytest.mark.slow
def test_it_is_searched_and_judged_as_a_pid_is_and_stands_beside_one(design):
    assert [r.form.name for r in design.rows[:4]] == ["LQI", "LQI", "PID", "PID"]
    assert design.best.share >= 0.9
    assert design.best.share > design.rows[1].share + 0.1
    told = [v.sentence for v in verdict(design, {})]
    assert (
        f"{100 * design.best.share:.0f} % have an overshoot under "
        "10 % and an Ms under 1.6; tuned on the best fit alone: " in told[0]
    )
    assert any(sentence.startswith("A PID tuned on the same plants: ") for sentence in told)
    first, pid = table(design)[0], table(design)[2]
    assert isinstance(first, ServoLoop)
    assert len(first.K) == 2
    assert isinstance(pid, PidLoop)
    assert pid.Kp > 0
    with pytest.raises(SimulationError, match="has no Kp, Ki and Kd"):
        design.best.gains  # noqa: B018


@pytest.mark.slow
def test_its_loops_are_those_of_a_plain_simulation(design):
    """Plant number 5 in plain numpy: its exact lag over fine steps, the dead time by a list of past inputs."""
    s, w = design.best.parameters, design.wishes
    p = {n: float(v[5]) for n, v in design.family.plants.items()}
    loop, fine, y = servo(0.5, lower=-10.0, upper=10.0), 200, 3.0
    u0 = (3.0 - p["c"]) / p["K"]
    state, update = loop.init(jnp.asarray(y), (s, u0)), jax.jit(loop.update)
    past, decay = [u0] * 400, np.exp(-0.5 / fine / p["tau"])
    seen = design.judge.responses(s)["y"][5]
    for k in range(len(seen)):
        assert seen[k] == pytest.approx(y, abs=0.02)
        state, command = update(state, y, w.set_point, (s, u0))
        past.append(float(command))
        for j in range(fine):
            drive = past[int(np.floor((k + (j + 0.5) / fine) - p["L"] / 0.5)) + 400] + (
                w.load if k >= design.course.begin else 0.0
            )
            goal = p["c"] + p["K"] * drive
            y = goal + (y - goal) * decay


@pytest.mark.slow
def test_the_promised_share_holds_on_a_thousand_fresh_plants_within_three_percent():
    """Judged on 1000 stated plants, then on 1000 fresh ones of the same distribution."""
    found = tuned_loop(family(80, 1), family(1000, 2), ASKED, budget=200, seed=3)
    fresh = family(1000, 77)
    rests = [fresh.at_rest(level, (-10.0, 0.0, 10.0)) for level in (3.0, 5.0)]
    w = frequencies(0.5, 12.0, 1200)
    h = sampled_response(rests[1], 0.5, w)
    for row in found.rows[:3]:
        judge = Judge.of(fresh, rests[0], found.course, 0.0, row.form)
        share = float(np.mean(judged_on(judge, row.form, [row.parameters], h, w, ASKED, 1).kept))
        print(f"{row.name}, {row.form.name}: promised {row.share:.3f}, fresh {share:.3f}")
        assert share == pytest.approx(row.share, abs=0.03)


def test_an_integrating_plant_gets_a_servo():
    law = "y' = K*delay(u, L) + leak\nz = y"
    tank = equations(law, inputs=["u"], states=["y"], outputs=["z"], parameters=["K", "L", "leak"], name="tank")
    loop = OneLoop(tank, "z", "u", {}, {"K": np.array([0.1]), "L": np.array([2.0]), "leak": np.array([-0.05])})
    wishes = Wishes(2.0, 1.0, 0.2, 0.5, -5.0, 5.0, ms=1.8, overshoot=30.0, controller="lqi")
    rest = loop.at_rest(2.0, (-5.0, 0.0, 5.0))
    small = reduced(rest, 0.25)
    form = lqi_form(ServoPlant.of(rest, small, wishes), small, wishes)
    given = form.made(form.space.cube(np.array([0.3, 3.0, 0.3, 1.0])))
    h = sampled_response(rest, 0.5, w := frequencies(0.5, 4.0, 1200))
    assert bool(margins(servo_response(given, 0.5, w)[None, :] * h, w, 2, unstable_poles(given)).stable[0])


def test_too_many_samples_of_dead_time_are_said():
    rest = rest_of(LAG, K=2.0, tau=10.0, L=20.0, c=1.0)
    with pytest.raises(SimulationError, match=r"The dead time is 400 samples of 0.05 s.*give a longer period"):
        plant_of(rest, Wishes(5.0, 2.0, 0.2, 0.05, -10.0, 10.0, controller="lqi"))


def test_a_plant_that_rests_far_from_zero_is_judged_by_the_commands_that_it_gets():
    """At rest at 24 % and the set point: the loop, which counts from rest, sees no command; a limit of 10 % is 14 %
    below it."""
    plant = {"A": np.diag([0.9, 1.0]), "B": np.array([[0.1], [0.0]]), "C": np.array([1.0, 0.0]), "D": 0.0}
    s = Servo(
        **plant,
        gain=np.array([0.5, 0.5]),
        K=np.array([1.0, 1.0]),
        P=np.zeros(0),
        f=1.0,
        share=1.0,
        rest=np.ones(2),
        u0=24.0,
        y0=40.0,
    )
    loop = from_rest(servo(1.0, lower=10.0, upper=80.0))
    begin = loop.init(jnp.asarray(40.0), (s, 24.0))
    assert float(loop.update(begin, 40.0, 40.0, (s, 24.0))[1]) == 0.0
    assert float(loop.update(begin, 400.0, 40.0, (s, 24.0))[1]) == -14.0
