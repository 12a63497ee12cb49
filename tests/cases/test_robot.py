"""The robot's speed loop against a plain loop in numpy and python-control, and the claim of a hundredth of the
evaluations."""

import numpy as np
import pytest
from scipy.linalg import expm

import plantfit
import plantfit.runtime
from plantfit.cases.robot.demo import BUDGET, TRUTH, bench, tuned_on
from plantfit.cases.robot.speed_loop import PERIOD, SAMPLES, SET_POINT, UPPER, fitness, objective, response
from plantfit.optimize import minimise
from plantfit.rig.dc_motor import ROBOT_MOTOR

import jax.numpy as jnp

MOTOR = {name: ROBOT_MOTOR[other] for name, other in TRUTH.items()}
GAINS = (0.1065, 40.0, 0.0004144)


def printed_loop(kp, ki, kd, step):
    """Eq. 3, 9 to 11 of the paper, u = Kp e + Ki sigma + Kd delta in whole counts, in plain numpy."""
    ra, la, kw, b, j = (MOTOR[n] for n in ("Ra", "La", "kw", "B", "J"))
    held = expm(np.array([[-ra / la, -kw / la, 1 / la], [kw / j, -b / j, 0], [0, 0, 0]]) * PERIOD)
    x, sigma, last, seen = np.zeros(2), 0.0, 0.0, []
    for _ in range(SAMPLES):
        seen.append(x[1])
        e = SET_POINT - (step * np.round(x[1] / step) if step else x[1])
        sigma += 0.5 * PERIOD * (e + last)
        u = np.round(np.clip(kp * e + ki * sigma + kd * (e - last) / PERIOD, 0.0, 255.0))
        last = e
        x = held[:2, :2] @ x + held[:2, 2] * (12.0 * u / 255)
    return np.array(seen)


@pytest.mark.parametrize("step", [0.0, 1.5])
def test_the_loop_is_the_printed_one(step):
    np.testing.assert_allclose(response(MOTOR, GAINS, step)[0].y, printed_loop(*GAINS, step), atol=1e-7)


def test_metrics_agree_with_python_control_and_the_fitness_with_eq_13():
    control = pytest.importorskip("control", reason="python-control is not installed")
    run, m = response(MOTOR, GAINS)
    y = np.asarray(run.y)
    info = control.step_info(y, T=np.asarray(run.t), yfinal=SET_POINT)
    assert m.overshoot == pytest.approx(info["Overshoot"], abs=1e-9)
    for ours, theirs in (("rise_time", "RiseTime"), ("settling_time", "SettlingTime"), ("peak_time", "PeakTime")):
        assert getattr(m, ours) == pytest.approx(info[theirs], abs=1e-12)
    by_hand = (
        info["Overshoot"] / 100
        + info["RiseTime"]
        + info["SettlingTime"]
        + info["PeakTime"]
        + abs(SET_POINT - y[-1]) / SET_POINT
    )
    assert float(fitness(m)) == pytest.approx(by_hand, rel=1e-9)
    assert float(objective(MOTOR).costs(jnp.array([GAINS]) / UPPER)[0]) == pytest.approx(by_hand, rel=1e-9)


def test_what_never_settles_costs_a_second_for_it():
    m = response(MOTOR, (0.0, 0.0, 0.0))[1]
    assert np.isinf(m.settling_time)
    # at rest all the time: rise and settling take the horizon, the first value is the largest, the error is the set
    # point
    assert float(fitness(m)) == pytest.approx(1.0 + 1.0 + 0.0 + 1.0, rel=1e-12)


def test_the_bench_settles_where_the_motor_does():
    run = bench()
    volts = run.exact["V"][-1]
    settled = volts * MOTOR["kw"] / (MOTOR["Ra"] * MOTOR["B"] + MOTOR["kw"] ** 2)
    assert volts == pytest.approx(3.0, abs=0.5 * 12 / 255)
    assert run.exact["w"][-1] == pytest.approx(settled, rel=1e-6)
    assert set(run.recording.signals) == {"duty", "N", "Tp", "I"}


@pytest.mark.slow
def test_a_hundredth_of_the_loops_reaches_the_genetic_algorithms_end():
    goal = objective(MOTOR)
    ga = minimise(goal, "elite_ga", runs=3, budget=BUDGET, seed=1, settings={"variant": "paper"})
    few = minimise(goal, "lshade", runs=20, budget=BUDGET // 100, seed=2)
    best = min(r.cost for r in ga)
    assert sum(r.cost <= best for r in few) >= 5


@pytest.mark.slow
def test_kalman_filters_on_the_bench_hold_the_truth_and_smooth(tmp_path):
    from plantfit.cases.robot.kalman import filtered, kalman_section
    from plantfit.cases.shared.files import unpack

    folder, run = unpack("robot", tmp_path), bench()
    run.save(folder)
    answer = plantfit.fit(plantfit.load(folder / "motor.toml").problem, budget=1000, seed=1)
    found = filtered(answer, MOTOR)
    section = kalman_section(found, run.exact, MOTOR)
    assert found.agree is True
    for p in found.record["parameters"]:
        for method in ("EKF", "UKF"):
            e = p["estimates"][method]
            assert e["low"] < MOTOR[p["name"]] < e["high"]
            assert e["high"] < 1.1 * e["low"]
    for _state, measured, after, smooth, known, nearer in section["tables"][1]["rows"]:
        assert float(after) < 0.1 * float(measured)
        assert float(smooth) < 0.1 * float(measured)
        assert float(nearer) < float(known) < float(after)
    assert len(section["figures"]) == 2
    tails = [v["sentence"].split(": ", 1)[-1].split(", ")[-1] for v in section["verdict"]]
    assert len(set(tails)) == len(tails)  # what is true of both filters is said once


def test_the_last_digits_of_a_fit_do_not_move_what_the_pid_is_tuned_on():
    other = {name: value * (1 + 1e-6) for name, value in MOTOR.items()}
    assert tuned_on(other) == tuned_on(MOTOR) != MOTOR
    assert all(abs(value / MOTOR[name] - 1) < 5e-4 for name, value in tuned_on(MOTOR).items())


@pytest.mark.parametrize("gains", [GAINS, (0.0, 12.2, 1e-4), (19.1, 8.6e-4, 0.025)])
def test_the_terms_whose_change_is_told_add_up_to_the_fitness(gains):
    from plantfit.cases.robot.gains_section import _terms

    m = response(MOTOR, gains)[1]
    assert _terms(m).sum() == pytest.approx(float(fitness(m)), rel=1e-9)


def test_the_filtered_record_settles_and_overshoots_as_the_motor_does():
    from plantfit.cases.robot.gains_section import constant_duty, measured_metrics
    from plantfit.cases.robot.signals_section import cleaned

    run = bench()
    final, seen = measured_metrics(cleaned(run))
    assert final == pytest.approx(run.exact["w"][-1], rel=2e-3)
    model = response(MOTOR, constant_duty(MOTOR))[1]
    assert seen.overshoot == pytest.approx(model.overshoot, abs=3.0)
    assert seen.peak_time == pytest.approx(model.peak_time, abs=1.5e-3)


def test_the_characteristics_of_figure_1_are_marked_where_the_curve_has_them():
    from plantfit.cases.robot.gains_section import constant_duty
    from plantfit.cases.robot.sections import EARLY, marked

    step, m = response(MOTOR, constant_duty(MOTOR))
    t, share = np.asarray(step.t), np.asarray(step.y) / SET_POINT
    notes = marked({"data": [], "layout": {}}, m, t, share)["layout"]["annotations"]
    rise, peak, settled, end = ((note["x"], note["y"]) for note in notes)
    assert peak == pytest.approx((t[np.argmax(share)], share.max()), abs=1e-4)
    assert rise[0] == pytest.approx(t[np.argmax(share >= 0.1)] + m.rise_time)
    assert np.all(np.abs(share[t >= settled[0]] - 1) <= 0.02)
    assert end == pytest.approx((EARLY, share[np.argmin(abs(t - EARLY))]), abs=1e-4)
    assert f"overshoot {m.overshoot:.0f} %" in notes[1]["text"]


def test_odometry_with_a_radius_for_each_wheel_is_the_cleaning_step_where_both_are_alike():
    from plantfit.cases.robot.drive_section import PULSES, odometry_of
    from plantfit.recording import odometry
    from plantfit.rig.offered import record_rig

    r = record_rig("robot_drive", excitation="0.5m,0.4m/90deg").recording
    way = odometry_of(r, {"radius_left": 0.032, "radius_right": 0.032, "track": 0.14})
    step = odometry(r, "N_left", "N_right", PULSES, 0.032, 0.14)
    for name, values in way._asdict().items():
        np.testing.assert_allclose(values, step[name], atol=1e-12)
