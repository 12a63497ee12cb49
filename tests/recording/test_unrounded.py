"""The smooth curve beside readings in steps, other readings of it, and which signals look rounded."""

import numpy as np
import pytest

from plantfit.recording import Recording, Signal
from plantfit.recording.looks.rounded import rounded_step
from plantfit.recording.signals.unrounded import misread, reread, unrounded


def path(n=600):
    """An angle in counts: rest, a ramp, a sine on it, rest."""
    t = np.arange(n) / n
    speed = 2.3 * np.clip(20 * np.minimum(t, 1 - t) - 1, 0, 1) * (1 + 0.3 * np.sin(12 * t))
    return np.cumsum(speed)


def test_the_curve_beside_counts_is_nearer_to_the_path_than_they_are():
    true = path()
    read = np.floor(true + 0.3)
    moves = slice(60, -60)
    off, far = (unrounded(read) - true)[moves], (read - true)[moves]
    assert np.std(off) < 0.85 * np.std(far)
    assert np.max(np.abs(unrounded(read) - read)) < 1.5


def test_a_signal_that_jumps_stays_as_it_is():
    levels = np.repeat(np.random.default_rng(1).integers(-50, 50, 60), 5).astype(float)
    assert np.max(np.abs(unrounded(levels) - levels)[20:-20]) < 1.0


def test_a_rest_stays_where_it_was_read():
    read = np.floor(path() + 0.3)
    assert np.all(unrounded(read)[-25:] == read[-1])
    assert np.all(unrounded(read)[:25] == read[0])


def test_short_signals_stay_as_they_are():
    for n in (1, 2, 5):
        np.testing.assert_allclose(unrounded(np.arange(n) ** 2.0), np.arange(n) ** 2.0, atol=1e-12)


def test_steps_read_a_curve_wrong_by_half_a_step_at_most_and_at_rest_by_the_same():
    error = misread(path(), 0.7)
    assert np.max(np.abs(error)) <= 0.5
    assert np.std(error) == pytest.approx(1 / np.sqrt(12), rel=0.1)
    assert np.ptp(misread(np.full(50, 3.2), 0.1)) == 0.0


def test_a_speed_of_counts_read_anew_has_the_same_path_within_a_step():
    t, step = 0.01 * np.arange(600), 0.02
    speed = np.diff(np.floor(path(601))) * step / 0.01
    speed[100] = np.nan
    other = reread(Recording(t, {"w": Signal(speed, "rad/s")}), "w", step, 2, counted=True)
    for r in other:
        assert np.isnan(r["w"][100])
        away = np.cumsum(np.nan_to_num(r["w"] - speed)) * 0.01
        assert 0.5 * step < np.ptp(np.delete(away, [100])) < 2.5 * step
    rounded = reread(Recording(t, {"u": Signal(np.round(np.sin(t), 1), "V")}), "u", 0.1, 1, counted=False)[0]
    assert np.max(np.abs(rounded["u"] - np.round(np.sin(t), 1))) <= 0.05 + 1e-9


def test_what_wanders_over_an_even_grid_looks_rounded():
    t = np.linspace(0, 6, 600)
    slow = np.sin(2 * np.pi * t) + 0.4 * np.sin(5 * t + 1)
    assert rounded_step(np.round(slow / 0.1) * 0.1) == pytest.approx(0.1)
    assert rounded_step(3.0 + np.round(slow / 0.25) * 0.25) == pytest.approx(0.25)


def test_readings_in_fine_steps_look_rounded_too():
    t = np.linspace(0, 6, 600)
    slow = np.sin(2 * np.pi * t) + 0.4 * np.sin(5 * t + 1)
    assert rounded_step(np.round(slow / 0.01) * 0.01) == pytest.approx(0.01)
    assert rounded_step(np.round(slow / 0.001) * 0.001) == pytest.approx(0.001)
    assert rounded_step(np.round(0.037 * t / 0.001) * 0.001) == pytest.approx(0.001)  # a ramp
    texts = [float(f"{v:.4f}") for v in np.round(slow / 0.00244) * 0.00244]  # steps that a log rounds once more
    assert rounded_step(np.array(texts)) == pytest.approx(0.00244, rel=1e-3)


@pytest.mark.parametrize(
    "kind",
    [
        "smooth", "two levels", "staircase", "random levels", "few levels", "uneven levels", "fine levels", "noisy",
        "ramps",
    ],
)  # fmt: skip
def test_commands_and_smooth_signals_do_not(kind):
    rng, t = np.random.default_rng(3), np.linspace(0, 6, 600)
    slow = np.sin(2 * np.pi * t)
    u = {
        "smooth": slow,
        "two levels": np.sign(slow),
        "staircase": np.repeat(np.r_[np.arange(10), np.arange(10)[::-1]], 30).astype(float),
        "random levels": np.repeat(rng.integers(0, 20, 120), 5).astype(float),
        "few levels": np.repeat(rng.integers(0, 9, 100), 6) / 4.0 - 1.0,
        "uneven levels": np.array([0.0, 1.0, 2.3, 3.1, 4.7, 5.2, 6.0])[np.round(3 + 3 * slow).astype(int)],
        "fine levels": np.repeat(np.round(rng.uniform(-1, 1, 120), 3), 5),
        "ramps": np.round(np.interp(t, [0, 3, 6], [0, 7.3, 0]), 9),
        "noisy": slow + 0.01 * rng.standard_normal(600),
    }[kind]
    assert rounded_step(u) is None


def test_readings_that_are_fresh_now_and_then_are_no_program_of_levels():
    """They change at every sixth sample only, as a program does, but go on as they went, or shake by one step."""
    slow = np.sin(2 * np.pi * np.linspace(0, 6, 600)[::6])
    assert rounded_step(np.repeat(np.round(slow / 0.1) * 0.1, 6)) == pytest.approx(0.1)
    noisy = 0.5 * slow + 0.04 * np.random.default_rng(1).normal(size=100)
    assert rounded_step(np.repeat(np.round(noisy / 0.1) * 0.1, 6)) == pytest.approx(0.1)
