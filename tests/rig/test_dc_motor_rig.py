"""The virtual motor bench: exact to a tight solver, its sensors true to closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit.recording as rec
from plantfit.errors import SimulationError
from plantfit.rig.dc_motor import ROBOT_MOTOR, DcMotorRig
from plantfit.rig.encoder import capture
from plantfit.rig.offered.dc_motor import board_excitation, board_rig

RIG = DcMotorRig()
RUN = RIG.record(seed=3)
PULSE = 2 * np.pi * RIG.ratio / RIG.pulses  # of the motor, rad


def test_the_exact_motion_agrees_with_a_tight_solver():
    p, volts = ROBOT_MOTOR, RUN.exact["V"][0]

    def rate(_, x):
        return [
            (volts - p["Rm"] * x[0] - p["Kb"] * x[1]) / p["Lm"],
            (p["Kt"] * x[0] - p["Cm"] * x[1]) / p["Jm"],
            x[1],
        ]

    t = RUN.exact.t[:100]
    x = solve_ivp(rate, (0, t[-1]), [0, 0, 0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=t).y
    np.testing.assert_allclose(RUN.exact["i"][:100], x[0], atol=1e-8)
    np.testing.assert_allclose(RUN.exact["w"][:100], x[1], atol=1e-5)
    np.testing.assert_allclose(RUN.exact["angle"][:100], x[2], atol=1e-5)
    settled = volts * p["Kt"] / (p["Rm"] * p["Cm"] + p["Kb"] * p["Kt"])
    assert RUN.exact["w"][-1] == pytest.approx(settled, rel=1e-9)
    assert RUN.exact["I"][-1] == pytest.approx(p["Cm"] * settled / p["Kt"], rel=1e-9)


@pytest.mark.parametrize("winding", [2.75e-6, 1e-3])
def test_a_winding_far_quicker_than_the_steps_is_followed(winding):
    """The motor of the Control Tutorials for MATLAB and Simulink (ctms.engin.umich.edu, Motor Position), whose
    winding takes 0.7 us."""
    p = {"Rm": 4.0, "Lm": winding, "Kb": 0.0274, "Kt": 0.0274, "Jm": 3.2284e-6, "Cm": 3.5077e-6, "Tf": 0.0}
    rig = replace(board_rig(p), period=0.1, substeps=200)
    run = rig.record(
        1, rec.Recording(np.arange(6) * 0.1, {"V": rec.Signal(np.array([3.0, -3.0, 6.0, 0.0, -1.0, -1.0]), "V")})
    )

    def rate(_, x, u):
        return [
            (u - p["Rm"] * x[0] - p["Kb"] * x[1]) / p["Lm"],
            (p["Kt"] * x[0] - p["Cm"] * x[1]) / p["Jm"],
        ]

    x, found = np.zeros(2), []
    for u in run.exact["V"][:-1]:
        x = solve_ivp(rate, (0, 0.1), x, method="Radau", rtol=1e-9, atol=1e-10, args=(u,)).y[:, -1]
        found.append(x)
    np.testing.assert_allclose(run.exact["w"][1:], np.array(found)[:, 1], atol=2e-4)
    np.testing.assert_allclose(run.exact["i"][1:], np.array(found)[:, 0], atol=2e-6)


def test_friction_and_load_stop_at_the_closed_form_speed():
    p = ROBOT_MOTOR | {"Tf": 5e-5}
    w = DcMotorRig(p, load=2e-4).record(1).exact
    volts = w["V"][-1]
    settled = (volts * p["Kt"] / p["Rm"] - 2e-4 - p["Tf"]) / (p["Cm"] + p["Kt"] * p["Kb"] / p["Rm"])
    assert w["w"][-1] == pytest.approx(settled, rel=1e-6)


def test_the_bridge_gives_whole_counts_that_cleaning_turns_back_into_volts():
    t = np.arange(500) * 2e-3
    wave = rec.Recording(t, {"V": rec.Signal(5 * np.sin(20 * t), "V")})
    run = RIG.record(1, wave)
    assert np.all(run.recording["duty"] == np.round(run.recording["duty"]))
    back = rec.duty_to_voltage(run.recording, "duty", "V", RIG.supply, 255, 8, RIG.efficiency)["V"]
    np.testing.assert_allclose(back, run.exact["V"], atol=1e-12)
    held = 5 * np.sin(20 * (np.floor(run.exact.t / 2e-3 + 1e-6) * 2e-3))
    assert np.max(np.abs(back - held)) <= RIG.volts_per_count / 2 + 1e-12
    assert np.min(run.exact["w"]) < -500
    assert np.min(run.recording["I"]) >= 0  # a meter of RMS hides the sign


def test_speed_from_the_period_errs_as_timer_and_slots_say():
    late = RUN.exact.t > 0.1
    true = RUN.exact["w"][-1]
    even = DcMotorRig(slot_error=0.0).record(3)
    timer = rec.period_to_speed(even.recording, "Tp", "w", RIG.pulses, RIG.ratio)["w"][late]
    length = PULSE / true
    assert np.max(np.abs(PULSE / timer - length)) <= RIG.tick * 1.0001
    assert np.mean(PULSE / timer) == pytest.approx(length, abs=RIG.tick / 20)
    rounding = length % RIG.tick * (RIG.tick - length % RIG.tick)
    spread = np.mean([np.var(RIG.record(seed).recording["Tp"][late]) for seed in range(10)])
    assert np.sqrt(spread) == pytest.approx(np.sqrt(2 * (RIG.slot_error * length) ** 2 + rounding), rel=0.04)
    exact = DcMotorRig(slot_error=0.0, tick=0.0).record(3).recording
    np.testing.assert_allclose(rec.period_to_speed(exact, "Tp", "w", RIG.pulses, RIG.ratio)["w"][late], true, rtol=1e-6)


def test_counts_are_the_angle_in_whole_pulses():
    even = DcMotorRig(slot_error=0.0).record(3)
    error = even.recording["N"] - even.exact["angle"] / PULSE - even.truth["encoder_phase_slots"]
    assert -1 - 1e-6 <= error.min() <= error.max() <= 1e-6


def test_pulses_of_a_shaft_that_turns_back_are_taken_off_and_a_rest_times_out():
    t = np.linspace(0, 1.0, 100_001)
    angle = 0.5 + 2.0 * np.sin(3 * t)  # turns back at t = pi/6
    seen = capture(t, angle, t[::100], 100, np.zeros(100), 0.0, 0.05)
    np.testing.assert_array_equal(
        seen.counts, np.floor(angle[::100] * 100 / (2 * np.pi)) - np.floor(angle[0] * 100 / (2 * np.pi))
    )
    turn = np.abs(t[::100] - np.pi / 6) < 0.005
    assert np.all(np.abs(seen.period[turn]) > 0.01)
    moving = (np.abs(np.cos(3 * t[::100])) > 0.5) & (t[::100] > 0.1)
    period = seen.period[moving]  # mean speed of up to two periods ago, under at most 18 rad/s^2
    assert np.all(np.abs(2 * np.pi / 100 / period - 6 * np.cos(3 * t[::100])[moving]) < 18 * 2 * np.abs(period))
    rest = capture(t, np.where(t < 0.5, 10 * t, 5.0), t[::100], 100, np.zeros(100), 0.0, 0.05)
    assert np.all(rest.period[t[::100] > 0.56] == 0.05)
    none = capture(t, np.full(len(t), 0.1), t[::100], 100, np.zeros(100), 0.0, 0.05)
    assert np.all(none.counts == 0)
    assert np.all(none.period == 0.05)


def test_the_current_is_read_over_its_window_with_noise_in_steps():
    run = RUN
    error = (run.recording["I"] - run.exact["I"])[run.exact["I"] > 0.02]
    assert np.std(error) == pytest.approx(np.hypot(2e-3, 1e-3 / np.sqrt(12)), rel=0.1)
    steps = run.recording["I"] / 1e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    t = np.linspace(0, 1e-3, 2001)
    i = np.interp(t + 3e-3, run.exact.t, run.exact["i"])  # coarse: 4 ms lies behind a smooth stretch
    assert run.exact["I"][4] == pytest.approx(np.sqrt(np.mean(i**2)), rel=0.03)


def test_a_hall_sensor_keeps_the_sign_of_the_current():
    t = np.arange(400) * 1e-3
    wave = rec.Recording(t, {"V": rec.Signal(6 * np.sin(30 * t), "V")})
    run = DcMotorRig(current="signed").record(2, wave)
    assert "I" not in run.recording.signals
    error = run.recording["i"] - run.exact["i"]
    assert np.min(run.recording["i"]) < -0.1 < 0.1 < np.max(run.recording["i"])
    assert np.std(error) == pytest.approx(np.hypot(2e-3, 1e-3 / np.sqrt(12)), rel=0.15)
    assert abs(np.mean(error)) < 4 * 2e-3 / np.sqrt(len(t))


def test_a_seed_gives_the_same_run_and_impossible_settings_are_refused():
    again, other = RIG.record(seed=3), RIG.record(seed=4)
    for name in RUN.recording.signals:
        assert np.array_equal(again.recording[name], RUN.recording[name])
    assert not np.array_equal(other.recording["Tp"], RUN.recording["Tp"])
    with pytest.raises(SimulationError, match=r"the bridge gives 11\.76 V"):
        RIG.record(1, 12.0)
    with pytest.raises(SimulationError, match="'Rm'"):
        DcMotorRig({})
    with pytest.raises(SimulationError, match="efficiency is 98"):
        DcMotorRig(efficiency=98)
    with pytest.raises(SimulationError, match="current is 'hall'"):
        DcMotorRig(current="hall")  # pyrefly: ignore[bad-argument-type]


def test_a_period_tells_of_the_speed_at_its_end_not_of_half_a_step_ago():
    """A shaft that speeds up evenly: edges lie where the parabola says, however coarse the steps are."""
    t = np.linspace(0, 1.0, 21)
    speed = 20.0 + 100.0 * t
    angle = 20.0 * t + 50.0 * t**2
    pulse = 2 * np.pi / 1000
    seen = capture(t, angle, t, 1000, np.zeros(1000), 0.0, 0.05, speed)
    last = np.floor(angle[1:] / pulse + 1e-9) * pulse
    when = lambda a: (-20.0 + np.sqrt(400.0 + 200.0 * a)) / 100.0  # noqa: E731
    np.testing.assert_allclose(seen.period[1:], when(last) - when(last - pulse), rtol=1e-9)
    straight = capture(t, angle, t, 1000, np.zeros(1000), 0.0, 0.05)
    assert np.all(pulse / straight.period[1:] < speed[1:] - 2.4)  # 25 ms late by 100 rad/s^2
    slowing = capture(t, -angle[::-1], t, 1000, np.zeros(1000), 0.0, 0.05, speed[::-1])
    np.testing.assert_allclose(pulse / slowing.period[1:], speed[::-1][1:], atol=0.06)


@pytest.mark.parametrize("seeds", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_errors_of_a_repeated_drive_come_back_unless_the_voltage_wanders(seeds):
    """Square waves of 5 s in which a motor settles: one settled reading says something of that 5 s later."""

    def correlation(wander):
        constants = {"Rm": 1.2, "Lm": 3e-3, "Kb": 0.05, "Kt": 0.05, "Jm": 4e-4, "Cm": 2e-4, "Tf": 4e-3}
        rig, pairs, size = replace(board_rig(constants), wander=wander), [], []
        for seed in range(seeds):
            run = rig.record(seed, board_excitation())
            speed = 2 * np.pi / rig.pulses / run.recording["Tp"]
            error = np.where(np.abs(run.exact["w"]) > 190.0, speed - run.exact["w"], np.nan)
            pairs.append(np.nanmean(error[50:] * error[:-50]))
            size.append(np.nanvar(error))
        return np.mean(pairs) / np.mean(size)

    assert correlation(0.0) > 0.15
    assert abs(correlation(0.002)) < 0.12
