"""Smith predictors: the principle itself, responses by what the controller does, C, the file, the search, and what
is refused."""

from dataclasses import replace

import numpy as np
import pytest
from test_tune_lqi import RESTS, ServoProgram, rest_of
from test_tune_pid import LAG, WISHES, family

import plantfit.runtime  # noqa: F401
from plantfit.control.c_export import smith_to_c
from plantfit.control.linear.smith import Smith, poles_outside, smith, smith_response, unlimited
from plantfit.control.pid import Gains, pid
from plantfit.control.tune import OneLoop, tuned_loop
from plantfit.control.tune.forms.smith_form import smith_form
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_scores import Limits
from plantfit.control.tune.reduction import reduced
from plantfit.control.tune.told import table, verdict
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import PidLoop, SmithLoop
from plantfit.models.text.equations import equations

import jax
import jax.numpy as jnp

ASKED = replace(WISHES, controller="smith")
GAINS = Gains(1.5, 0.2, 1.0, 0.7, 0.0, 0.3)
PLANTS = ["lag", "second", "two ways late"]


def two_ways_late():
    model = equations(
        "a' = (K*delay(u, L) - a)/t1\nb' = (a + 0.3*delay(u, M) - b)/t2\nz = b", inputs=["u"], states=["a", "b"],
        outputs=["z"],
        parameters=["K", "t1", "t2", "L", "M"], name="two ways late",
    )  # fmt: skip
    return rest_of(model, K=2.0, t1=4.0, t2=3.0, L=1.7, M=3.1)


def rest_named(which):
    return two_ways_late() if which == "two ways late" else RESTS[which]()


def predictor(which, gains=GAINS, taken=0.2):
    """A predictor of a plant, and its samples of dead time; the gain of "second" is negative."""
    if which == "second":
        gains = gains._replace(Kp=-gains.Kp, Ki=-gains.Ki, Kd=-gains.Kd)
    rest = rest_named(which)
    plant = ServoPlant.of(rest, reduced(rest, 0.25), ASKED)
    a = plant.advanced
    steady = np.linalg.solve(np.eye(len(a.moves)) - a.moves, a.drive[:, 0])
    return Smith(gains, a.moves, a.drive[:, 0], a.seen, steady, taken, plant.u0, plant.y0), plant.ahead


def given(s, lower=-np.inf, upper=np.inf, rest=None):
    return s, s.u0 if rest is None else rest, Limits(lower, upper, 0.0)


@pytest.mark.parametrize("which", PLANTS)
def test_with_the_true_model_the_loop_is_that_of_the_plant_without_dead_time_later(which):
    """The principle of the predictor: the same input, the output `ahead` samples behind."""
    s, ahead = predictor(which)
    law, plain = smith(0.5, ahead, "clamping"), pid(0.5)
    state, bare = law.init(jnp.asarray(s.y0), given(s)), plain.init(jnp.asarray(s.y0), s.gains)
    bare = bare._replace(integral=s.u0 - s.gains.Kp * (s.gains.b - 1.0) * s.y0)
    x, fast, line = np.zeros(len(s.A)), np.zeros(len(s.A)), [0.0] * ahead
    for _ in range(60):
        y, ideal = s.y0 + line[-1], s.y0 + float(s.C @ fast)
        state, command = law.update(state, y, s.y0 + 1.0, given(s))
        bare, wanted = plain.update(bare, ideal, s.y0 + 1.0, s.gains)
        assert float(command) + s.u0 == pytest.approx(float(wanted), abs=1e-9)
        line = [float(s.C @ x), *line[:-1]]
        x, fast = s.A @ x + s.B * float(command), s.A @ fast + s.B * (float(wanted) - s.u0)
    assert abs(ideal - s.y0 - 1.0) < 0.2


@pytest.mark.parametrize("which", PLANTS)
@pytest.mark.further(2)
def test_response_and_poles_are_those_of_what_the_controller_does(which):
    """The z-transform of its answer to an impulse, on a circle where it converges."""
    s, ahead = predictor(which)
    law, h = smith(0.5, ahead, "clamping"), 0.5
    state = law.init(jnp.asarray(s.y0), given(s))
    y = s.y0 + np.r_[1.0, np.zeros(399)]
    _, u = jax.lax.scan(lambda c, v: law.update(c, v, s.y0, given(s)), state, jnp.asarray(y))
    angles = np.array([0.1, 0.7, 2.0])
    z = 1.3 * np.exp(1j * angles)
    truth = -np.sum(np.asarray(u)[:, None] * z[None, :] ** -np.arange(400)[:, None], axis=0)
    w = (angles - 1j * np.log(1.3)) / h
    np.testing.assert_allclose(smith_response(s, pid_response(s.gains, h, w), ahead, h, w), truth, rtol=1e-6)
    assert poles_outside(law, (s, s.u0, unlimited())) == 0


def test_an_unstable_inner_loop_is_counted():
    """A gain far too high for the plant without dead time makes the controller itself unstable."""
    s, ahead = predictor("second", Gains(200.0, 10.0, 0.0, 1.0, 0.0, 0.3))
    assert poles_outside(smith(0.5, ahead, "none"), (s, s.u0, unlimited())) >= 1


@pytest.mark.parametrize("filtered", [1.0, 0.1])
def test_the_set_point_is_met_on_a_plant_of_another_gain_and_dead_time_under_a_load(filtered):
    s, ahead = predictor("lag", GAINS._replace(Kp=1.0, Ki=0.1, Kd=0.0), filtered)
    law, update = (
        smith(0.5, ahead, "clamping"),
        jax.jit(lambda c, y: smith(0.5, ahead, "clamping").update(c, y, s.y0 + 0.5, given(s))),
    )
    state, x, past = law.init(jnp.asarray(s.y0), given(s)), np.zeros(len(s.A)), [0.0] * (ahead + 2)
    y = s.y0
    for _ in range(600):
        state, command = update(state, y)
        past = [float(command) + 0.3, *past[:-1]]  # a load of 0.3, one sample more of dead time, 30 % more gain
        x = s.A @ x + 1.3 * s.B * past[ahead + 1]
        y = s.y0 + float(s.C @ x)
    assert y == pytest.approx(s.y0 + 0.5, abs=1e-6)


def test_it_begins_at_rest_whatever_input_holds_the_true_plant():
    s, ahead = predictor("second")
    law = smith(0.5, ahead, "clamping")
    state = law.init(jnp.asarray(3.0), given(s, rest=7.5))
    for _ in range(4):
        state, command = law.update(state, 3.0, 3.0, given(s, rest=7.5))
        assert float(command) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("which", PLANTS)
@pytest.mark.parametrize("anti_windup", ["clamping", "back-calculation", "none"])
@pytest.mark.further(5)
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, which, anti_windup):
    s, ahead = predictor(which)
    rng, follow = np.random.default_rng(1), 0.5 / 4.0 if anti_windup == "back-calculation" else 0.0
    r = 5 + 0.4 * (np.arange(10_000) // 700 % 2)
    y = r + 0.3 * np.sin(np.arange(10_000) / 37.0) + rng.normal(0, 0.02, 10_000)
    law = smith(0.5, ahead, anti_windup)

    def commands(lower, upper):
        held = (s, 2.0, Limits(lower, upper, follow))
        found = jax.lax.scan(
            lambda c, v: law.update(c, v[0], v[1], held),
            law.init(jnp.asarray(y[0]), held),
            (jnp.asarray(y), jnp.asarray(r)),
        )
        return np.asarray(found[1]) + 2.0

    lower, upper = np.round(np.quantile(commands(-1e9, 1e9), (0.2, 0.8)), 3)
    settings = {
        "period": 0.5,
        "lower": lower,
        "upper": upper,
        "anti_windup": anti_windup,
        "tracking_time": 4.0 if follow else None,
    }
    program = ServoProgram(smith_to_c(s, tmp_path, ahead=ahead, name="level", **settings))
    program.begin(y[0], 2.0)
    told = np.array([program.update(a, b) for a, b in zip(y, r, strict=True)])
    assert (told.min(), told.max()) == (lower, upper)
    assert np.mean((told > lower) & (told < upper)) > 0.1
    np.testing.assert_allclose(told, commands(lower, upper), rtol=1e-12, atol=1e-11)


def test_a_plant_with_an_integrator_or_without_dead_time_is_refused():
    law = "y' = K*delay(u, L) + leak\nz = y"
    tank = equations(law, inputs=["u"], states=["y"], outputs=["z"], parameters=["K", "L", "leak"], name="tank")
    loop = OneLoop(tank, "z", "u", {}, {"K": np.array([0.1]), "L": np.array([2.0]), "leak": np.array([-0.05])})
    wishes = replace(ASKED, set_point=2.0, step=1.0)
    rest = loop.at_rest(2.0, (-5.0, 0.0, 5.0))
    small = reduced(rest, 0.25)
    with pytest.raises(
        SimulationError, match=r"has an integrator, and a Smith predictor never removes a load.*'lqi' or 'mpc'"
    ):
        smith_form(ServoPlant.of(rest, small, wishes), small, 1, wishes, None)
    rest = rest_of(LAG, K=2.0, tau=10.0, L=0.2, c=1.0)
    small = reduced(rest, 0.25)
    with pytest.raises(
        SimulationError, match=r"dead time is shorter than a sample of 0.5 s.*'pid', or a shorter period"
    ):
        smith_form(ServoPlant.of(rest, small, ASKED), small, 1, ASKED, None)


@pytest.fixture(scope="module")  # of slow tests
def design():
    """Dead time longer than the lag, known to 4 %."""
    late, fresh = (
        replace(f, plants={**f.plants, "L": 6.0 * f.plants["L"]})
        for f in (family(40, 1, spread=0.2), family(80, 2, spread=0.2))
    )
    return tuned_loop(late, fresh, ASKED, budget=150, seed=3)


@pytest.mark.slow
def test_where_the_dead_time_is_long_and_known_its_step_is_faster_than_that_of_a_pid(design):
    assert [r.form.name for r in design.rows[:3]] == ["Smith predictor", "Smith predictor", "PID"]
    best, pid_row = design.best, design.rows[2]
    assert best.share >= 0.95
    assert pid_row.scores.iae > 1.3 * best.scores.iae
    first, beside = table(design)[0], table(design)[2]
    assert isinstance(first, SmithLoop)
    assert first.ahead == 24
    assert isinstance(beside, PidLoop)
    assert any("A PID tuned on the same plants: " in v.sentence for v in verdict(design, {}))


@pytest.mark.slow
def test_its_loops_are_those_of_a_plain_simulation(design):
    """Plant number 5 in plain numpy: its exact lag over fine steps, the dead time by a list of past inputs."""
    s, w = design.best.parameters, design.wishes
    p = {n: float(v[5]) for n, v in design.family.plants.items()}
    u0 = (3.0 - p["c"]) / p["K"]
    held = (s, u0, Limits(-10.0, 10.0, 0.0))
    law, fine, y = smith(0.5, design.best.form.ahead, "clamping"), 200, 3.0
    state, update = law.init(jnp.asarray(y), held), jax.jit(law.update)
    past, decay = [u0] * 400, np.exp(-0.5 / fine / p["tau"])
    seen = design.judge.responses(s)["y"][5]
    for k in range(len(seen)):
        assert seen[k] == pytest.approx(y, abs=0.02)
        state, command = update(state, y, w.set_point, held)
        past.append(float(command) + u0)
        for j in range(fine):
            drive = past[int(np.floor((k + (j + 0.5) / fine) - p["L"] / 0.5)) + 400] + (
                w.load if k >= design.course.begin else 0.0
            )
            goal = p["c"] + p["K"] * drive
            y = goal + (y - goal) * decay
