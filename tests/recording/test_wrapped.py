"""Angles and counters that begin anew at the end of their range."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import PlantfitError
from plantfit.recording import Recording, Signal
from plantfit.recording.clean.wraps import wraps_of
from plantfit.recording.looks import signal_looks


def _motion(rng, n, period):
    """A position that turns, both ways or one way, at most a fifth of the period a sample."""
    speed = np.cumsum(rng.normal(0, 1, n)) / np.sqrt(n) if rng.random() < 0.5 else np.abs(rng.normal(1, 0.2, n))
    speed = np.convolve(speed, np.ones(9) / 9, "same")
    return rng.uniform(0, period) + np.cumsum(speed * period * rng.uniform(0.05, 0.18) / np.abs(speed).max())


@pytest.mark.parametrize(
    ("unit", "period"), [("deg", 360.0), ("rad", 2 * np.pi), (None, 360.0), (None, 4096.0), (None, 65536.0)]
)
def test_what_turns_is_seen_and_runs_on(unit, period):
    seen = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(200, 1500))
        true = _motion(rng, n, period) + 1e-3 * period * rng.normal(size=n)
        low = rng.choice([0.0, -period / 2])
        y = (true - low) % period + low
        leaps = np.abs(np.diff(y)) > period / 2
        if np.ptp(true) < 1.3 * period or not leaps.any():
            continue
        r = Recording(0.01 * np.arange(n), {"y": Signal(y, unit)}, "r")
        looks = [k for k in signal_looks(r, "y", True) if k.kind == "wrapped"]
        if not looks:
            continue
        seen += 1
        assert looks[0].figures == {"period": pytest.approx(period), "times": int(leaps.sum())}
        on = rec.unwrap(r, "y", f"{period} {unit}" if unit else period)["y"]
        np.testing.assert_allclose(on - on[0], true - true[0], atol=1e-9 * period)
    assert seen > 25


def test_a_pendulum_that_hangs_where_its_sensor_begins_anew():
    t = 0.02 * np.arange(600)
    y = (40 * np.exp(-0.1 * t) * np.cos(5 * t) + 0.3 * np.random.default_rng(1).normal(size=600)) % 360
    assert wraps_of(y, "deg") is not None
    r = rec.unwrap(Recording(t, {"y": Signal(y, "deg")}, "r"), "y", "6.283185307179586 rad")
    assert np.ptp(r["y"]) < 90


def test_other_leaps_are_no_wraps():
    for seed in range(60):
        rng = np.random.default_rng(500 + seed)
        n = int(rng.integers(200, 1500))
        t = np.arange(n)
        switch = np.repeat(rng.integers(0, 2, n // 20 + 1), 20)[:n] * 360.0
        lag = np.zeros(n)
        for k in range(1, n):
            lag[k] = lag[k - 1] + (switch[k - 1] - lag[k - 1]) * rng.uniform(0.1, 0.9)
        spikes = (
            180 + 30 * np.sin(t / 30) + np.where(rng.random(n) < 0.01, 179, 0) - np.where(rng.random(n) < 0.01, 179, 0)
        )
        duty = np.repeat(rng.integers(0, 256, n // 20 + 1), 20)[:n].astype(float)
        bounce = np.abs(360 * np.sin(t / 40))
        for y in (switch, switch + rng.normal(0, 1, n), lag, spikes, duty, bounce, 360 * rng.random(n)):
            assert wraps_of(y, None) is None, seed
            assert wraps_of(y, "deg") is None, seed


def test_missing_samples_are_passed_over_and_wrong_periods_refused():
    y = np.array([350.0, np.nan, 5, 20, np.nan, 350])
    r = Recording(np.arange(6.0), {"y": Signal(y, "deg"), "n": Signal(y, None)}, "r")
    np.testing.assert_array_equal(rec.unwrap(r, "y", 360)["y"], [350, np.nan, 365, 380, np.nan, 350])
    np.testing.assert_allclose(rec.unwrap(r, "y", "1 turn")["y"], [350, np.nan, 365, 380, np.nan, 350])
    for name, period, told in (
        ("y", 0, "above 0"), ("y", -5, "above 0"), ("y", "3 m", "period"), ("n", "360 deg", "give a number"),
        ("y", "", "period"), ("y", True, "period"),
    ):  # fmt: skip
        with pytest.raises(PlantfitError, match=told):
            rec.unwrap(r, name, period)
