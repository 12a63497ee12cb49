"""Root loci of sampled loops: against margins, a characteristic polynomial, and the poles of a loop written out."""

import numpy as np
import pytest
from test_tune_cascade import GAINS, WISHES, closed_poles, drive, family
from test_tune_lqi import ASKED as LQI
from test_tune_lqi import plant_of
from test_tune_pid import LAG
from test_tune_pid import WISHES as PID
from test_tune_pid import family as lags

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.tune import OneLoop, rule_gains
from plantfit.control.tune.forms.cascade_form import cascade_form
from plantfit.control.tune.forms.loop_poles import FACTORS, loop_poles
from plantfit.control.tune.forms.pid_form import pid_form
from plantfit.control.tune.forms.servo_forms import lqi_form
from plantfit.control.tune.frequency import frequencies, margins, sampled_response
from plantfit.control.tune.reduction import reduced

MIDDLE = len(FACTORS) // 2


def pid_of(loop, rest):
    small = reduced(rest, 0.25)
    rules = {name: isa for name in ("SIMC", "AMIGO") if (isa := rule_gains(name, small)) is not None}
    return pid_form(small, 1, PID, rules, None)


def largest(poles):
    """The pole farthest out (F,) but for the integral action, which never lies outside."""
    return np.max(np.abs(poles), axis=1)


@pytest.mark.parametrize(("kp", "ki", "kd"), [(1.0, 0.1, 0.0), (2.0, 0.2, 1.0), (0.5, 0.05, 0.0), (3.5, 0.3, 4.0)])
@pytest.mark.thorough
def test_the_factor_at_which_a_pole_leaves_the_unit_circle_is_the_gain_margin(kp, ki, kd):
    loop = lags(2, 3)
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    form, gains = pid_of(loop, rest), Gains(kp, ki, kd, 1.0, 0.0, 0.3)
    size = largest(loop_poles(loop, rest, form, gains, 5.0, 0.5))
    w = frequencies(0.5, 12.0, 4000)
    seen = margins(form.response(gains, w)[None] * sampled_response(rest, 0.5, w), w, 1)
    assert (size[MIDDLE] < 1.0) == bool(seen.stable[0])
    out = int(np.argmax(size > 1.0 + 1e-9))
    assert 0 < out < len(FACTORS)
    crossing = np.exp(np.interp(1.0, size[out - 1 : out + 1], np.log(FACTORS[out - 1 : out + 1])))
    assert float(seen.gain[0]) == pytest.approx(crossing, rel=5e-3)


def test_poles_of_a_lag_under_a_pi_are_the_roots_of_its_polynomial():
    """Without dead time and filter: (z - 1)(z - a) + b (Kp (z - 1) + Ki h / 2 (z + 1)) in z, times the factor."""
    loop = OneLoop(
        LAG, "z", "u", {}, {"K": np.array([2.0]), "tau": np.array([10.0]), "L": np.array([0.0]), "c": np.array([1.0])}
    )
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    kp, ki, a = 1.5, 0.2, np.exp(-0.05)
    b = 2.0 * (1.0 - a)
    found = loop_poles(loop, rest, pid_of(loop, rest), Gains(kp, ki, 0.0, 1.0, 0.0, 0.0), 5.0, 0.5)
    for factor, poles in zip(FACTORS, found, strict=True):
        truth = np.roots(
            np.polyadd(np.polymul([1.0, -1.0], [1.0, -a]), factor * b * np.array([kp + 0.25 * ki, 0.25 * ki - kp]))
        )
        moving = poles[np.abs(poles) > 1e-9]  # the last error and the idle derivative have poles at 0
        np.testing.assert_allclose(np.sort_complex(moving), np.sort_complex(truth), atol=1e-9)


@pytest.mark.parametrize("which", ["chain", "drive"])
@pytest.mark.thorough
def test_poles_of_a_cascade_are_those_of_the_loop_written_out(which):
    loop = family(0, 1) if which == "chain" else drive()
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    form = cascade_form(reduced(rest, 0.25), reduced(loop.of_inner(rest), 0.25), ("z", "m"), WISHES, None)
    found = loop_poles(loop, rest, form, GAINS, 5.0, 0.5)
    truth = closed_poles(rest, GAINS, 0.5)
    np.testing.assert_allclose(np.sort(np.abs(found[MIDDLE]))[-4:], np.sort(np.abs(truth))[-4:], rtol=1e-8)


@pytest.mark.thorough
def test_a_servo_is_stable_at_its_own_gain_and_not_at_ten_times_it():
    """Inputs on their way through the dead time are states of plant and servo alike."""
    loop = OneLoop(
        LAG, "z", "u", {}, {"K": np.array([2.0]), "tau": np.array([10.0]), "L": np.array([2.2]), "c": np.array([1.0])}
    )
    rest = loop.at_rest(5.0, (-10.0, 0.0, 10.0))
    form = lqi_form(plant_of(rest, LQI), reduced(rest, 0.25), LQI)
    size = largest(loop_poles(loop, rest, form, form.made(form.space.cube(np.array([0.3, 3.0, 0.3, 1.0]))), 5.0, 0.5))
    assert size[MIDDLE] < 1.0
    assert size[-1] > 1.0
