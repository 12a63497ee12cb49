"""Duty, encoder, RMS current and odometry against closed forms."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.recording import Recording, Signal
from plantfit.spec import CLEANING

GEAR, PULSES = 43 / 9, 500


def made(t, **signals):
    return Recording(
        t, {name: Signal(v) if isinstance(v, np.ndarray) else Signal(*v) for name, v in signals.items()}, "run"
    )


def test_duty_in_counts_shares_and_percent_give_one_voltage():
    counts = np.array([-255.0, -64.0, 0.0, 1.0, 128.0, 255.0])
    t = np.arange(6.0)
    for scale in (255.0, 1.0, 100.0):
        r = rec.duty_to_voltage(
            made(t, d=counts / 255 * scale), "d", "V", supply=12.0, full_scale=scale, efficiency=0.98
        )
        np.testing.assert_allclose(r["V"], 0.98 * 12 * counts / 255, atol=1e-12)
        assert r.signals["V"].unit == "V"
    share = np.linspace(-1, 1, 1001)
    r = rec.duty_to_voltage(made(np.arange(1001.0), d=share), "d", "V", 10.0, 1.0, bits=8)
    error = r["V"] - 10 * share
    assert np.max(np.abs(error)) <= 10 / 255 / 2 + 1e-12
    assert len(np.unique(r["V"])) == 511
    np.testing.assert_array_equal(
        rec.duty_to_voltage(made(np.arange(1001.0), d=share), "d", "V", 10.0, 1.0, bits=None)["V"], 10 * share
    )


def test_a_sagging_battery_is_taken_from_its_signal():
    t = np.arange(3.0)
    r = rec.duty_to_voltage(made(t, d=np.full(3, 51.0), B=(np.array([12.0, 11.0, 10.0]), "V")), "d", "V", "B", 255)
    np.testing.assert_allclose(r["V"], [2.4, 2.2, 2.0])
    with pytest.raises(RecordingError, match="convert_units"):
        rec.duty_to_voltage(made(t, d=np.ones(3), B=(np.ones(3), "mV")), "d", "V", "B", 255)
    with pytest.raises(RecordingError, match="256 at 1 s"):
        rec.duty_to_voltage(made(t, d=np.array([0.0, 256.0, 0.0])), "d", "V", 12.0, 255)


def test_speed_of_a_steady_shaft_from_counts_and_from_the_period():
    speed, period = 300.0, 1e-3
    t = np.arange(400) * period
    angle = 2 * np.pi * GEAR / PULSES  # of the motor, per pulse
    counted = np.floor(speed * t / angle + 0.3)
    r = rec.counts_to_speed(made(t, N=counted), "N", "w", PULSES, GEAR)
    quantum = angle / period
    assert np.isnan(r["w"][0])
    assert np.all(np.abs(r["w"][1:] / quantum - np.round(r["w"][1:] / quantum)) < 1e-6)
    assert np.max(np.abs(r["w"][1:] - speed)) < quantum
    assert np.mean(r["w"][1:]) == pytest.approx(speed, abs=quantum / 399)
    us = np.full(400, round(angle / speed * 1e6))
    r = rec.period_to_speed(made(t, Tp=(us.astype(float), "us")), "Tp", "w", PULSES, GEAR)
    assert r["w"][0] == pytest.approx(GEAR * 2 * np.pi / 500 / 200e-6, rel=1e-12)  # 200 us
    assert r["w"][0] == pytest.approx(speed, abs=1.5)


def test_a_counter_of_16_bits_that_overflows_is_followed_over_gaps():
    true = np.cumsum(np.r_[0, np.random.default_rng(1).integers(-900, 1500, 999)]).astype(float)
    seen = np.mod(true + 32768, 65536) - 32768
    assert np.max(np.abs(true - seen)) > 60_000
    seen[400:404] = np.nan
    r = rec.counts_to_angle(made(np.arange(1000) * 0.01, N=seen), "N", "a", 2000, 0.5, wrap_bits=16)
    there = np.isfinite(seen)
    np.testing.assert_allclose(r["a"][there], np.pi * true[there] / 2000, rtol=1e-12)
    assert np.isnan(r["a"][400:404]).all()
    speed = rec.counts_to_speed(made(np.arange(1000) * 0.01, N=seen), "N", "w", 2000, 0.5, wrap_bits=16)["w"]
    assert np.isnan(speed[400:405]).all()
    np.testing.assert_allclose(speed[1:400], np.pi * np.diff(true[:400]) / 2000 / 0.01, rtol=1e-6)


def test_timeouts_are_rest_and_impossible_periods_are_refused():
    t = np.arange(3.0)
    r = made(t, Tp=(np.array([0.05, 0.1, -0.02]), "s"))
    np.testing.assert_allclose(rec.period_to_speed(r, "Tp", "w", 100, timeout=0.1)["w"], [2 * np.pi / 5, 0.0, -np.pi])
    with pytest.raises(RecordingError, match="0 at 1 s"):
        rec.period_to_speed(made(t, Tp=(np.array([1.0, 0.0, 1.0]), "s")), "Tp", "w", 100)
    with pytest.raises(RecordingError, match="no unit"):
        rec.period_to_speed(made(t, Tp=np.ones(3)), "Tp", "w", 100)
    with pytest.raises(RecordingError, match="already has a signal"):
        rec.period_to_speed(r, "Tp", "Tp", 100)


def test_rms_of_a_ripple_on_a_level_has_its_closed_form():
    t = np.arange(2000) * 1e-4
    current = 0.3 + 0.1 * np.sin(2 * np.pi * 250 * t + 0.4)
    r = rec.moving_rms(made(t, i=(current, "A")), "i", "I", 0.012)  # three periods
    assert np.isnan(r["I"][:119]).all()
    np.testing.assert_allclose(r["I"][119:], np.sqrt(0.3**2 + 0.1**2 / 2), rtol=1e-12)
    assert r.signals["I"].unit == "A"
    with pytest.raises(RecordingError, match="1 samples"):
        rec.moving_rms(made(t, i=current), "i", "I", 1e-4)


def test_odometry_drives_a_circle_exactly_and_a_spiral_as_a_fine_integral():
    radius, track, counts = 0.03, 0.2, 2000
    v, turn = 0.5, 0.8
    t = np.linspace(0, 2 * np.pi / turn, 13)  # a whole circle in coarse steps
    to_counts = counts / (2 * np.pi * radius)
    wheels = {"L": (v - turn * track / 2) * t * to_counts, "R": (v + turn * track / 2) * t * to_counts}
    wheels["R"][5] = np.nan  # one arc over the gap
    r = rec.odometry(made(t, **wheels), "L", "R", counts, radius, track, start=(1.0, 2.0, 0.3))
    there = np.arange(13) != 5
    np.testing.assert_allclose(
        r["x"][there], (1 + v / turn * (np.sin(0.3 + turn * t) - np.sin(0.3)))[there], atol=1e-12
    )
    np.testing.assert_allclose(
        r["y"][there], (2 - v / turn * (np.cos(0.3 + turn * t) - np.cos(0.3)))[there], atol=1e-12
    )
    np.testing.assert_allclose(r["heading"][there], (0.3 + turn * t)[there], atol=1e-12)
    assert r["distance"][-1] == pytest.approx(v * t[-1], rel=1e-12)
    assert np.isnan(r["x"][5])


def test_rounded_counts_leave_the_pose_near_the_true_one():
    radius, track, counts, ratio = 0.03, 0.2, 2000, 0.1
    t = np.arange(20_001) * 1e-3
    left, right = 0.4 * t + 0.1 * np.sin(t), 0.5 * t
    to_counts = counts / (2 * np.pi * radius * ratio)
    r = rec.odometry(
        made(t, L=np.floor(left * to_counts), R=np.floor(right * to_counts)), "L", "R", counts, radius, track, ratio
    )
    heading = (right - left) / track
    speed = 0.5 * (0.4 + 0.1 * np.cos(t) + 0.5)
    x = np.concatenate(
        [[0], np.cumsum(np.diff(t) * 0.5 * ((speed * np.cos(heading))[1:] + (speed * np.cos(heading))[:-1]))]
    )
    assert np.max(np.abs(r["x"] - x)) < 5e-4
    assert np.max(np.abs(r["heading"] - heading)) < 2 / to_counts / track


def test_a_duty_gets_the_sign_of_its_direction():
    t, duty = np.arange(6.0), np.array([0.0, 10, 20, 30, 40, np.nan])
    for levels, forward, expected in (
        ([1, 1, 0, 0, 1, 0], None, [0, 10, -20, -30, 40, np.nan]),
        ([1, 1, -1, -1, 1, 1], None, [0, 10, -20, -30, 40, np.nan]),
        ([1, 1, 2, 2, 1, 1], 1, [0, 10, -20, -30, 40, np.nan]),
    ):
        r = rec.signed(made(t, pwm=(duty, "%"), dir=np.array(levels, dtype=float)), "pwm", "dir", "u", forward)
        np.testing.assert_array_equal(r["u"], expected)
        assert r.signals["u"].unit == "%"
    for way, forward, told in (
        (np.ones(6), None, "has 1 level,"),
        (np.array([0, 1, 2, 0, 1, 2.0]), None, "has 3 levels"),
        (np.array([0, 1, np.nan, 0, 1, 0]), None, "missing values"),
        (np.array([0, 1, 1, 0, 1, 0.0]), 2.0, "forward is 2, but 'dir' is 0 or 1"),
    ):
        with pytest.raises(RecordingError, match=told):
            rec.signed(made(t, pwm=duty, dir=way), "pwm", "dir", "u", forward)
    with pytest.raises(RecordingError, match="has a sign already"):
        rec.signed(made(t, pwm=-duty, dir=np.array([0, 1, 1, 0, 1, 0.0])), "pwm", "dir", "u")


def test_all_of_them_are_steps_of_a_study_file():
    assert {
        "duty_to_voltage",
        "counts_to_angle",
        "counts_to_speed",
        "period_to_speed",
        "moving_rms",
        "odometry",
        "signed",
    } <= set(CLEANING)
