"""Step metrics against closed forms of a second-order system, against python-control, and under changes of scale."""

import numpy as np
import pytest

from plantfit.control import step_metrics, step_observer
from plantfit.errors import SimulationError

T = np.arange(0.0, 12.0, 1e-3)


def second_order(t, damping, frequency=2.0):
    """Unit step response of w^2 / (s^2 + 2 d w s + w^2)."""
    if damping < 1:
        ringing = frequency * np.sqrt(1 - damping**2)
        shape = np.cos(ringing * t) + damping / np.sqrt(1 - damping**2) * np.sin(ringing * t)
        return 1 - np.exp(-damping * frequency * t) * shape
    root = np.sqrt(damping**2 - 1)
    slow, fast = frequency * (damping - root), frequency * (damping + root)
    return 1 - (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow)


@pytest.mark.parametrize("damping", [0.2, 0.45, 0.7])
def test_overshoot_and_peak_time_have_their_closed_form(damping):
    m = step_metrics(T, second_order(T, damping), 1.0)
    assert m.overshoot == pytest.approx(100 * np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), rel=1e-5)
    assert m.peak_time == pytest.approx(np.pi / (2 * np.sqrt(1 - damping**2)), abs=1e-3)
    assert m.steady_state_error == pytest.approx(1 - second_order(T[-1], damping), abs=1e-15)


def test_first_order_rise_and_settling_have_their_closed_form():
    m = step_metrics(T, 1 - np.exp(-T / 0.5), 1.0)
    assert m.rise_time == pytest.approx(0.5 * np.log(9), abs=1.001e-3)
    assert m.settling_time == pytest.approx(0.5 * np.log(50), abs=1.001e-3)
    assert m.overshoot == 0


@pytest.mark.parametrize("damping", [0.15, 0.5, 0.8, 1.4])
@pytest.mark.parametrize(("band", "rise"), [(0.02, (0.1, 0.9)), (0.05, (0.0, 0.95)), (0.1, (0.2, 0.7))])
def test_agrees_with_python_control(damping, band, rise):
    control = pytest.importorskip("control", reason="python-control is not installed")
    y = 3.0 * second_order(T, damping)
    ours = step_metrics(T, y, 3.0, band, rise)
    info = control.step_info(y, T=T, yfinal=3.0, SettlingTimeThreshold=band, RiseTimeLimits=rise)
    assert ours.overshoot == pytest.approx(info["Overshoot"], abs=1e-9)
    assert ours.peak_time == pytest.approx(info["PeakTime"], abs=1e-12)
    assert ours.settling_time == pytest.approx(info["SettlingTime"], abs=1e-12)
    assert ours.rise_time == pytest.approx(info["RiseTime"], abs=1e-12)


@pytest.mark.parametrize(("scale", "shift", "late"), [(-4.0, 0.0, 0.0), (250.0, -30.0, 0.0), (0.01, 5.0, 7.0)])
def test_only_the_error_has_a_unit(scale, shift, late):
    y = second_order(T, 0.3)
    plain, moved = step_metrics(T, y, 1.0), step_metrics(T + late, scale * y + shift, scale + shift)
    assert moved.overshoot == pytest.approx(plain.overshoot, rel=1e-9)
    assert moved.steady_state_error == pytest.approx(scale * plain.steady_state_error, rel=1e-6, abs=1e-12)
    for name in ("rise_time", "settling_time", "peak_time"):
        assert getattr(moved, name) == pytest.approx(getattr(plain, name), abs=1.001e-3), name


def test_times_stretch_with_the_clock():
    y = second_order(T, 0.3)
    plain, slow = step_metrics(T, y, 1.0), step_metrics(60.0 * T, y, 1.0)
    for name in ("rise_time", "settling_time", "peak_time"):
        assert getattr(slow, name) == pytest.approx(60.0 * getattr(plain, name), rel=1e-12), name
    assert slow.overshoot == plain.overshoot


def test_what_never_happens_takes_infinite_time():
    m = step_metrics(T, 0.5 * second_order(T, 0.9), 1.0)
    assert m.rise_time == np.inf
    assert m.settling_time == np.inf
    assert m.steady_state_error == pytest.approx(0.5, rel=1e-3)
    ringing = step_metrics(T, 1 + 0.1 * np.sin(40 * T) - (T == 0), 1.0)
    assert ringing.settling_time == np.inf


def test_a_response_that_blows_up_never_settles():
    y = second_order(T, 0.5)
    y[8000:] = np.nan
    m = step_metrics(T, y, 1.0)
    assert m.settling_time == np.inf
    assert np.isnan(m.steady_state_error)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: step_metrics([0, 1], [0, 1, 2], 1.0), "one length"),
        (lambda: step_metrics([], [], 1.0), "one length"),
        (lambda: step_metrics([0, 1], [0, 1], [1.0, 2.0]), "one final value"),
        (lambda: step_metrics([0, 1], [2, 1], 2.0), "no step to judge"),
        (lambda: step_observer(band=0.0), "share of the step"),
        (lambda: step_observer(rise=(0.9, 0.1)), "increasing"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()
