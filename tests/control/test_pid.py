"""The PID against its difference equations, its continuous limit and what anti-windup promises."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit.control import Gains, pid
from plantfit.errors import SimulationError

H = 0.05
ERRORS = np.random.default_rng(3).normal(size=60)


def commands(controller, reference, measured, gains):
    """Commands (n,) of a controller run sample by sample; at rest before, at the first measurement."""
    state, found = controller.init(np.float64(measured[0]), gains), []
    for r, y in zip(reference, measured, strict=True):
        state, command = controller.update(state, y, r, gains)
        found.append(float(command))
    return np.array(found)


@pytest.mark.parametrize("filter_time", [0.0, 0.2])
def test_equals_the_transfer_functions_of_its_parts(filter_time):
    gains = Gains(1.3, 0.7, 0.4, filter_time=filter_time)
    u = commands(pid(H), ERRORS, np.zeros(60), gains)
    integral = lfilter([0.7 * H / 2, 0.7 * H / 2], [1, -1], ERRORS)  # Tustin
    derivative = lfilter([0.4, -0.4], [filter_time + H, -filter_time], ERRORS)  # backward difference
    np.testing.assert_allclose(u, 1.3 * ERRORS + integral + derivative, rtol=1e-12, atol=1e-12)


def test_set_point_weights_leave_the_answer_to_the_measurement_alone():
    y = ERRORS - ERRORS[0]  # at rest where the reference is
    plain = commands(pid(H), np.zeros(60), y, Gains(2.0, 0.5, 0.1))
    weighted = commands(pid(H), np.zeros(60), y, Gains(2.0, 0.5, 0.1, b=0.3, c=0.0))
    np.testing.assert_allclose(weighted, plain, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("level", [0.0, 20.0])
@pytest.mark.parametrize("c", [0.0, 1.0])
def test_only_a_weighted_derivative_is_kicked_by_a_step_of_the_reference(c, level):
    u = commands(pid(H), level + np.ones(3), level + np.zeros(3), Gains(0.0, 0.0, 0.4, c=c))
    np.testing.assert_allclose(u, [c * 0.4 / H, 0.0, 0.0], atol=1e-12)


def test_tends_to_the_continuous_controller():
    errors = []
    for h in (0.02, 0.01):
        t = np.arange(0.0, 2.0, h)
        u = commands(pid(h), np.sin(t), np.zeros_like(t), Gains(1.0, 2.0, 0.3))
        errors.append(np.max(np.abs(u - (np.sin(t) + 2.0 * (1 - np.cos(t)) + 0.3 * np.cos(t)))[1:]))
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)  # the backward difference is of first order


@pytest.mark.parametrize(("kind", "extra"), [("clamping", {}), ("back-calculation", {"tracking_time": 0.1})])
def test_anti_windup_leaves_the_limit_soon_after_the_error_turns(kind, extra):
    reference = np.where(np.arange(120) < 100, 1.0, -1.0)
    gains, y = Gains(0.5, 1.0), np.zeros(120)
    free = commands(pid(H, lower=-1.0, upper=1.0, anti_windup="none"), reference, y, gains)
    held = commands(pid(H, lower=-1.0, upper=1.0, anti_windup=kind, **extra), reference, y, gains)
    assert np.all(np.abs(held) <= 1.0)
    assert free[105] == 1.0  # wound up: still at the wrong limit
    assert held[105] < 0.5


def test_clamping_still_integrates_back_from_a_limit():
    controller = pid(H, lower=0.0, upper=1.0)
    u = commands(controller, np.r_[np.full(50, -1.0), np.full(50, 1.0)], np.zeros(100), Gains(0.0, 1.0))
    assert np.all(u[:50] == 0.0)
    np.testing.assert_allclose(u[51:60], H * np.arange(1, 10), atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pid(0.0), "period"),
        (lambda: pid(H, lower=1.0, upper=0.0), "lower below upper"),
        (lambda: pid(H, anti_windup="magic"), "clamping"),
        (lambda: pid(H, tracking_time=1.0), "back-calculation"),
        (lambda: pid(H, anti_windup="back-calculation"), "give both or neither"),
        (lambda: pid(H, anti_windup="back-calculation", tracking_time=H / 2), "at least one period"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()
