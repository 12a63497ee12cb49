"""Readings that look back, at the times that they tell of: against closed forms and against the virtual bench's
exact signals."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.recording import Recording, Signal
from plantfit.rig.dc_motor import DcMotorRig

SLOT = 2 * np.pi / 500 * 43 / 9


def speeds(rig, seed=3, **options):
    r = rig.record(seed).recording
    return rec.period_to_speed(r, "Tp", "w", rig.pulses, rig.ratio, counts="N", lag="late", slot="slot", **options)


def test_the_mean_of_a_line_over_a_window_is_the_line_half_a_window_before():
    t, window = np.arange(100) * 0.1, 0.3
    r = Recording(
        t, {"mean": Signal(2 * (t - window / 2), "A"), "u": Signal(np.floor(t), "V"), "y": Signal(t**2, "m")}, "run"
    )
    back = rec.backdate(r, "mean", window / 2, hold=["u"])
    there = np.isfinite(back["mean"])
    assert there.sum() == 98  # two would lie before the start
    np.testing.assert_allclose(back["mean"][there], 2 * back.t[there], atol=1e-12)
    np.testing.assert_array_equal(back["u"], np.floor(back.t + 1e-12))
    assert np.isnan(back["y"][there]).all()
    np.testing.assert_array_equal(back["y"][np.isfinite(back["y"])], t**2)
    assert "98 samples of 'mean' were moved back by 0.15 s" in back.log[-1]


@pytest.mark.parametrize("periods", [1, 3, 7])
def test_whole_periods_back_are_samples_again_and_not_times_just_before_them(periods):
    t = 0.2 + np.arange(100) * 0.01
    u = np.random.default_rng(1).standard_normal(100)
    late = np.concatenate([np.full(periods, np.nan), u[:-periods]])
    back = rec.backdate(Recording(t, {"y": Signal(late), "u": Signal(u)}, "run"), "y", periods * 0.01, hold=["u"])
    np.testing.assert_array_equal(back.t, t)
    np.testing.assert_array_equal(back["y"][: 100 - periods], back["u"][: 100 - periods])


def test_each_sample_may_have_a_delay_of_its_own():
    t = np.arange(4.0)
    y = np.array([0.0, 1.0, 2.0, np.nan])
    late = np.array([0.0, 250.0, 500.0, np.nan])
    r = Recording(t, {"y": Signal(y), "k": Signal(10 * y), "late": Signal(late, "ms")}, "run")
    back = rec.backdate(r, ["y", "k"], "late")
    np.testing.assert_array_equal(back.t, [0.0, 0.75, 1.0, 1.5, 2.0, 3.0])
    np.testing.assert_array_equal(back["y"], [0.0, 1.0, np.nan, 2.0, np.nan, np.nan])
    np.testing.assert_array_equal(back["k"], 10 * back["y"])


@pytest.mark.parametrize("period", [2e-4, 5e-5])  # of about two pulses, and of half a one
def test_a_motor_that_speeds_up_is_seen_where_it_was(period):
    rig = DcMotorRig(
        slot_error=0.0, tick=0.0, duration=0.03, period=period, window=period, substeps=round(period / 1e-6)
    )
    before, after = [], []
    for seed in range(8):  # phases of the disc
        run, r = rig.record(seed), speeds(rig, seed)
        back = rec.backdate(r, "w", "late")
        for kept, seen in ((before, r), (after, back)):
            there = np.isfinite(seen["w"]) & (seen.t > 0.004)
            kept.append(seen["w"][there] - np.interp(seen.t[there], run.exact.t, run.exact["w"]))
    before, after = np.concatenate(before), np.concatenate(after)
    assert np.mean(before) < -0.6
    assert abs(np.mean(after)) < 0.05 * abs(np.mean(before))
    assert np.sqrt(np.mean(after**2)) < 0.4 * np.sqrt(np.mean(before**2))


def test_a_period_that_was_read_before_is_left_out():
    rig = DcMotorRig(slot_error=0.0, tick=0.0, duration=0.03, period=5e-5, window=5e-5, substeps=50)
    r = speeds(rig)
    fresh = np.isfinite(r["w"])
    np.testing.assert_array_equal(fresh[1:], np.diff(r["N"]) != 0)
    assert not fresh[0]


def test_the_mean_speed_of_uneven_slots_is_right_once_their_error_is_known():
    # slots change from turn to turn
    rig = DcMotorRig(slot_error=0.08, tick=0.0, duration=0.4, period=2.3e-4, window=2.3e-4, substeps=10)
    late = slice(round(0.05 / rig.period), None)
    for known, off in ((0.0, 3 * 0.08**2), (0.08, 0.0)):
        means = []
        for seed in range(25):
            r = speeds(rig, seed, slot_error=known)
            means.append(np.nanmean(r["w"][late]) / rig.record(seed).exact["w"][-1] - 1)
        error = np.std(means) / np.sqrt(len(means))
        assert error < 0.002
        assert np.mean(means) == pytest.approx(off, abs=3 * error)


def test_a_slot_is_recognised_at_every_turn_in_both_directions():
    for sign in (1.0, -1.0):
        rig = DcMotorRig(slot_error=0.1, tick=0.0, duration=0.5, pulses=20)
        wave = Recording(np.array([0.0, 0.5]), {"V": Signal(np.array([3.0, 3.0]) * sign, "V")}, "step")
        run = rig.record(5, wave)
        r = rec.period_to_speed(run.recording, "Tp", "w", rig.pulses, rig.ratio, counts="N", slot="slot")
        steady = np.isfinite(r["w"]) & (r.t > 0.1)
        assert set(r["slot"][steady]) == set(range(20))
        assert np.std(r["w"][steady]) > 20.0
        for k in range(20):
            assert np.ptp(r["w"][steady & (r["slot"] == k)]) < 1e-2
        widths = [np.mean(run.exact["w"][-1] / r["w"][steady & (r["slot"] == k)]) for k in range(20)]
        assert np.sum(widths) == pytest.approx(20.0, rel=1e-5)  # all slots are one turn


def test_what_cannot_be_is_said_in_a_sentence():
    t = np.arange(4.0)
    r = Recording(
        t, {"y": Signal(t), "late": Signal(np.array([0.0, -1.0, 0.0, 0.0]), "s"), "Tp": Signal(t + 1, "s")}, "run"
    )
    with pytest.raises(RecordingError, match=r"backdate\('y'\): the delay at 1 s is -1 s; give 0 or more"):
        rec.backdate(r, "y", "late")
    with pytest.raises(RecordingError, match="give seconds, or the name of a signal"):
        rec.backdate(r, "y", np.inf)
    with pytest.raises(RecordingError, match="no unit"):
        rec.backdate(r, "late", "y")
    with pytest.raises(RecordingError, match="no signal 'V'"):
        rec.backdate(r, "y", 0.1, hold=["V"])
    with pytest.raises(RecordingError, match="give counts"):
        rec.period_to_speed(r, "Tp", "w", 100, lag="lag")
    with pytest.raises(RecordingError, match=r"slot_error is 2; give a share of a slot from 0 to 0\.3"):
        rec.period_to_speed(r, "Tp", "w", 100, slot_error=2)
