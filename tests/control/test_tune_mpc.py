"""Predictive servos: plans by OSQP on the same problem not condensed, loops with limits beside LQI, C, and what is
refused."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from test_mpc import by_osqp
from test_tune_lqi import ASKED, RESTS, ServoProgram, plant_of
from test_tune_pid import LAG, WISHES, family

import plantfit.runtime  # noqa: F401
from plantfit.cli.terminal.out import plain
from plantfit.control.c_export import servo_mpc_to_c
from plantfit.control.linear.predictive.quadratic import Split
from plantfit.control.linear.predictive.servo_mpc import growing, multiplications, servo_mpc
from plantfit.control.linear.servo import servo
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.forms.servo_forms import lqi_form, mpc_form
from plantfit.control.tune.loop_scores import Judge, StepAndLoad, slewed
from plantfit.control.tune.reduction import reduced
from plantfit.control.tune.told import settings, table, verdict
from plantfit.control.tune.weights.plan_weights import SOFTNESS, PlanShape
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import check_wishes
from plantfit.errors import SimulationError
from plantfit.findings.results.tuned_controller import LoopFigures, PredictiveLoop
from plantfit.models.text.equations import equations
from plantfit.rig.offered.tuned import read_tuned

import jax
import jax.numpy as jnp

MPC = replace(ASKED, controller="mpc", lower=1.6, upper=2.9, rate=0.5, output_upper=5.3)
NEGATIVE = replace(MPC, lower=-3.4, upper=-2.1)
WEIGHTS = (0.05, 10.0, 2.0, 3.0)


def shaped(which, **more):
    return asked_for(replace(NEGATIVE if which == "second" else MPC, **more), which)


@pytest.mark.parametrize("which", ["lag", "no dead time", "two ways"])
@pytest.mark.thorough
def test_the_first_command_is_that_of_osqp_over_all_inputs(which):
    """All inputs of the horizon unknown, outputs by running the plant with its past inputs; the cost to go after the
    last one."""
    shape = shaped(which, prediction=5.0)
    plant, moves = shape.plant, int(np.sum(shape.lengths))
    assert np.all(shape.lengths == 1)
    given = shape.predictive(*WEIGHTS)
    n, p = len(plant.A), plant.B.shape[1] - 1
    ahead = plant.ahead
    cost = np.asarray(plant.regulator(WEIGHTS[0])[1])
    rng = np.random.default_rng(3)
    x, load, past, last, level = 0.05 * rng.normal(size=n), 0.1, 0.2 * rng.normal(size=p), -0.05, 0.28

    def run(u):
        """Outputs after each input that is planned, and the cost, as deviations from rest at `level`."""
        state, inputs, ys, costs = x.copy(), list(past + load), [], 0.0
        goal_x, goal_u = plant.target[:n] * level, plant.target[n] * level
        for j in range(moves + ahead):
            inputs = [u[j] + load if j < moves else np.nan, *inputs]
            acting = np.array(inputs[: p + 1])
            acting = np.where(np.any(plant.B != 0, axis=0), acting, 0.0)
            if j >= ahead:
                late = np.array(inputs[ahead + 1 : p + 1]) - goal_u
                z = np.r_[state - goal_x, late]
                seen = plant.advanced.seen @ z
                costs += (seen / plant.step) ** 2 + WEIGHTS[0] * ((u[j - ahead] + load - goal_u) / plant.u_size) ** 2
            state = plant.A @ state + plant.B @ acting
            if j >= ahead:
                ys.append(plant.C @ state + (plant.D * inputs[0] if plant.D else 0.0))
        z = np.r_[state - goal_x, np.array(inputs[ahead:p]) - goal_u]
        return np.array(ys), costs + z @ cost @ z

    eye, zero = np.eye(moves), np.zeros(moves)
    y0, c0 = run(zero)
    rows = np.stack([run(e)[0] - y0 for e in eye], axis=1)
    single, both = np.array([run(e)[1] for e in eye]), np.array([[run(a + b)[1] for b in eye] for a in eye])
    hessian = both - single[:, None] - single[None, :] + c0  # e_i' H e_j, cost = u' H u / 2 + g' u
    gradient = single - c0 - 0.5 * np.diag(hessian)
    change = eye - np.eye(moves, k=-1)
    begin = np.r_[last, np.zeros(moves - 1)]
    soft = SOFTNESS / plant.step**2
    # cost / 2 as the condensed one, shifted so that it has no linear term: OSQP takes the gradient by the centre of the
    # quadratic
    centre = -np.linalg.solve(hessian, gradient)
    whole = sp.block_diag([0.5 * hessian, soft * np.eye(moves)])
    none = np.zeros((moves, moves))
    constraints = np.block([[eye, none], [change, none], [rows, eye]])
    high = np.r_[np.full(moves, shape.high[0]) - centre, np.full(moves, shape.high[1]) + begin - change @ centre,
                 np.full(moves, shape.high[2]) - y0 - rows @ centre]  # fmt: skip
    low = np.r_[
        np.full(moves, shape.low[0]) - centre,
        np.full(moves, shape.low[1]) + begin - change @ centre,
        np.full(moves, -1e9),
    ]
    theirs = by_osqp(whole.toarray(), constraints, low, high)[:moves] + centre
    loop = servo_mpc(moves, True, steps=6000)
    s = given.servo
    # the filter is to leave the state as it is, and the set point to be there
    state = (
        jnp.append(x, load),
        jnp.asarray(past),
        jnp.asarray(level),
        jnp.asarray(last),
        Split(*(jnp.zeros(3 * moves),) * 2),
    )
    seen = float(s.C @ np.append(x, load) + (s.D * past[0] if p else 0.0))
    ours = float(loop.update(state, s.y0 + seen, s.y0 + level, (given, s.u0))[1] - s.u0)
    assert ours == pytest.approx(theirs[0], abs=2e-5)
    free = float(loop.update((*state[:4], state[4]), s.y0 + seen, s.y0 + level, (unlimited(given), s.u0))[1] - s.u0)
    assert abs(free - ours) > 0.02  # the limits act here
    assert free == pytest.approx(centre[0], abs=1e-9)  # the LQ optimum


def unlimited(given):
    far = jnp.full(given.plan.low.shape, 1e6)
    return given._replace(plan=given.plan._replace(low=-far, high=far, rate=jnp.asarray(1e6)))


@pytest.mark.parametrize("which", RESTS)
@pytest.mark.thorough
def test_without_a_limit_it_is_the_servo(which):
    shape = shaped(which)
    given, h = shape.predictive(*WEIGHTS), 0.5
    loops = servo_mpc(len(shape.lengths), True), servo(h)
    parameters = (unlimited(given), 2.0), (given.servo, 2.0)
    rng = np.random.default_rng(1)
    y = jnp.asarray(5.0 + 0.1 * rng.normal(size=50))
    seen = [
        jax.lax.scan(lambda s, v, loop=loop, p=p: loop.update(s, v, 5.2, p), loop.init(y[0], p), y)[1]
        for loop, p in zip(loops, parameters, strict=True)
    ]
    np.testing.assert_allclose(seen[0], seen[1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("samples", "moves"), [(5, 16), (16, 16), (29, 16), (400, 16)])
def test_moves_grow_and_fill_the_horizon(samples, moves):
    found = growing(samples, moves)
    assert found.sum() == samples
    assert len(found) == min(samples, moves)
    assert np.all(np.diff(found[:-1]) >= 0)
    assert found[0] == 1


@pytest.mark.parametrize("which", ["two ways", "no dead time", "lag"])
def test_the_c_file_equals_python_over_ten_thousand_samples(tmp_path, which):
    shape = shaped(which)
    given = jax.tree.map(np.asarray, shape.predictive(*WEIGHTS))
    rng = np.random.default_rng(1)
    r = 5 + 0.4 * (np.arange(10_000) // 70 % 2)
    y = r + 0.3 * np.sin(np.arange(10_000) / 37.0) + rng.normal(0, 0.02, 10_000)
    loop = servo_mpc(len(shape.lengths), True)
    begin, rows = loop.init(jnp.asarray(y[0]), (given, 2.0)), (jnp.asarray(y), jnp.asarray(r))
    _, truth = jax.lax.scan(lambda s, v: loop.update(s, *v, (given, 2.0)), begin, rows)
    files = servo_mpc_to_c(given, tmp_path, period=0.5, inputs=len(shape.lengths), rated=True, name="level")
    program = ServoProgram(files)
    program.begin(y[0], 2.0)
    told = np.array([program.update(a, b) for a, b in zip(y, r, strict=True)])
    assert told.min() == pytest.approx(1.6, abs=1e-12)
    assert told.max() == pytest.approx(2.9, abs=1e-12)
    changes = np.abs(np.diff(told))
    assert changes.max() <= 0.25 + 1e-12
    assert np.mean(changes > 0.2499) > 0.001  # of the rate's limit
    assert np.mean((told > 1.61) & (told < 2.89)) > 0.1
    np.testing.assert_allclose(told, np.asarray(truth), rtol=1e-12, atol=3e-12)
    assert f"{multiplications(given)} multiplications" in files.header.read_text()


@pytest.mark.parametrize("limits", [{}, {"rate": np.inf, "output_upper": np.inf}])
def test_the_controller_is_read_back_from_its_file(tmp_path, limits):
    """Written as `plantfit tune` writes it, read as `plantfit record` does: the same commands."""
    shape = shaped("two ways", **limits)
    given = shape.predictive(*WEIGHTS)
    wishes = plain(replace(MPC, **limits).__dict__)
    signals = {"output": {"name": "z", "unit": None}, "input": {"name": "u", "unit": None}}
    figures: Any = {
        **dict.fromkeys(LoopFigures.model_fields, 0.5),
        "stable": True,
        "worst": {},
        "meets": {"overshoot": 0.5},
    }  # its share of plants is not the servo's share
    row = PredictiveLoop(name="all plants", source="", form="MPC", **settings(given), **figures).plain()
    assert row["share"] == 0.5  # of plants, which is not the servo's share
    record = plain({"controllers": [row], "wishes": wishes, "plan": {"moves": shape.lengths}, **signals})
    (tmp_path / "x-tune.json").write_text(json.dumps(record, allow_nan=False))
    tuned = read_tuned(tmp_path / "x-tune.json")
    assert tuned.form == "MPC"
    running, loop = tuned.running(), servo_mpc(len(shape.lengths), shape.rated)
    running.begin(5.0)
    state, update = loop.init(jnp.asarray(5.0), (given, 0.0)), jax.jit(loop.update)
    for k in range(8):
        state, command = update(state, 5.0 + 0.1 * np.sin(k), 5.2, (given, 0.0))
        assert running.update(5.0 + 0.1 * np.sin(k), 5.2) == pytest.approx(float(command), rel=1e-12)
    # as older files are, in which the share of the plants stood in its place
    del record["controllers"][0]["set_point_share"]
    (tmp_path / "x-tune.json").write_text(json.dumps(record, allow_nan=False))
    with pytest.raises(SimulationError, match=r"x-tune\.json was written before plantfit kept how fast the set point"):
        read_tuned(tmp_path / "x-tune.json")


def scores(plant, wishes, weights, lags=None):
    """`LoopScores` of the MPC and of the LQI of the same weights on a plant."""
    start, rest = (
        plant.at_rest(level, (-10.0, 0.0, 10.0)) for level in (wishes.set_point - wishes.step, wishes.set_point)
    )
    small = reduced(rest, 0.5 * wishes.period)
    servo_plant = ServoPlant.of(rest, small, wishes)
    lqi = lqi_form(servo_plant, small, wishes)
    mpc = mpc_form(servo_plant, small, wishes, lqi.starts)
    course = StepAndLoad(wishes.set_point - wishes.step, wishes.set_point, wishes.load, 60.0, wishes.period,
                         wishes.output_lower,
                         wishes.output_upper)  # fmt: skip
    found: list[dict[str, float]] = []
    for form in (mpc, lqi):
        made = form.made(form.space.cube(np.array(weights)))
        judge = Judge.of(plant, start, course, wishes.quantum, form)
        seen = jax.jit(judge.scores)(jax.tree.map(lambda v: jnp.asarray(v)[None], made))
        found.append({k: float(v[0, 0]) for k, v in seen._asdict().items()})
    return found


@pytest.mark.thorough
def test_with_limits_of_the_input_it_is_at_least_as_good_as_lqi_without_windup():
    """A step that takes nearly all of the input, for half of its time at the limit."""
    plant = OneLoop(
        LAG, "z", "u", {}, {"K": np.array([2.0]), "tau": np.array([10.0]), "L": np.array([2.0]), "c": np.array([1.0])}
    )
    wishes = Wishes(5.0, 4.0, 0.15, 0.5, 0.0, 2.3, controller="mpc")
    mpc, lqi = scores(plant, wishes, (0.01, 10.0, 0.3, 0.5))
    assert mpc["iae"] <= lqi["iae"] * 1.001
    assert mpc["load_iae"] <= lqi["load_iae"] * 1.001
    assert mpc["overshoot"] < 5.0


@pytest.mark.thorough
def test_it_keeps_a_limit_of_the_output_that_lqi_does_not():
    """A lightly damped plant: an LQ servo overshoots by more than the limit leaves, the plan does not."""
    text = "q' = v\nv' = w*w*(K*delay(u, L) - q) - 2*d*w*v\nz = q"
    spring = equations(
        text, inputs=["u"], states=["q", "v"], outputs=["z"], parameters=["K", "w", "d", "L"], name="spring"
    )
    plant = OneLoop(
        spring, "z", "u", {}, {"K": np.array([1.0]), "w": np.array([1.0]), "d": np.array([0.15]), "L": np.array([0.4])}
    )
    wishes = Wishes(5.0, 2.0, -0.2, 0.2, 0.0, 8.0, controller="mpc", output_upper=5.02)
    mpc, lqi = scores(plant, wishes, (1.0, 30.0, 0.1, 0.3))
    assert lqi["outside"] > 2 * wishes.tolerated
    assert mpc["outside"] <= wishes.tolerated
    assert mpc["iae"] < 1.5 * lqi["iae"]


def test_an_actuator_that_is_slow_is_slow_for_every_controller():
    """Commands counted from rest move by the limit at most, for a controller that does not know it too."""
    from plantfit.simulate.loop.controller import Controller

    jump = Controller(lambda measurement, p: (), lambda state, measurement, reference, p: (state, jnp.asarray(3.0)))
    loop, seen = slewed(jump, 1.25), []
    state = loop.init(0.0, None)
    for _ in range(4):
        state, command = loop.update(state, 0.0, 0.0, None)
        seen.append(float(command))
    assert seen == [1.25, 2.5, 3.0, 3.0]
    assert slewed(jump, np.inf) is jump


def asked_for(wishes, which="lag"):
    check_wishes(wishes)
    rest = RESTS[which]()
    return PlanShape.of(plant_of(rest, wishes), reduced(rest, 0.5 * wishes.period), wishes)


def refused(**more):
    with pytest.raises(SimulationError) as said:
        asked_for(replace(MPC, **more))
    return str(said.value)


def test_what_cannot_be_asked_for_is_said_in_a_sentence():
    assert "The plan looks 2 s ahead and an input acts after 2 s of dead time" in refused(prediction=2.0)
    assert "give at most" in refused(prediction=500.0)
    assert "the step goes from 3 to 5; choose another set point" in refused(output_upper=4.5)
    assert "rate = 0 lets the input never move" in refused(rate=0.0)
    assert "A prediction is what an MPC plans for" in refused(prediction=20.0, controller="lqi")
    plants = family(20, 1)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"upper": 1.9}, "they cannot hold that set point"),
        ({"load": 3.0}, "Against a load of 3 V"),
    ]
    for more, sentence in wrong:
        with pytest.raises(SimulationError, match=sentence):
            tuned_loop(plants, plants, replace(MPC, lower=0.0, **more))
    law = equations(
        "y' = K*u + 0.2*y\nz = y", inputs=["u"], states=["y"], outputs=["z"], parameters=["K"], name="unstable"
    )
    unstable = OneLoop(law, "z", "u", {}, {"K": np.ones(4)})
    with pytest.raises(SimulationError, match="The plant is unstable at z = 5"):
        tuned_loop(unstable, unstable, replace(MPC, lower=-5.0, upper=5.0, output_upper=9.0))
    text = "y' = K*u - y\nr' = 0*u\nz = y + r"
    lasting = equations(text, inputs=["u"], states=["y", "r"], outputs=["z"], parameters=["K"], name="lasting")
    stuck = OneLoop(lasting, "z", "u", {}, {"K": np.ones(4)})
    with pytest.raises(SimulationError, match="u does not reach 'r'"):
        tuned_loop(stuck, stuck, replace(MPC, lower=-9.0, upper=9.0))


@pytest.mark.slow
def test_it_is_searched_and_judged_beside_lqi_pid_and_rules():
    """Limits of the input that bind at every step: the MPC costs no more than the LQI whose weights it began with."""
    wishes = replace(WISHES, controller="mpc", upper=3.2, output_upper=5.15)
    found = tuned_loop(family(20, 1), family(60, 2), wishes, budget=60, seed=3)
    assert [r.form.name for r in found.rows[:4]] == ["MPC", "MPC", "LQI", "PID"]
    assert found.best.share >= found.rows[2].share - 0.02
    told = [v.sentence for v in verdict(found, {})]
    assert any("of the plants keep the output at or below 5.15, to" in sentence for sentence in told)
    assert any(sentence.startswith("An LQI tuned on the same plants: ") for sentence in told)
    first = table(found)[0]
    assert isinstance(first, PredictiveLoop)
    assert len(first.free) == len(first.low)
