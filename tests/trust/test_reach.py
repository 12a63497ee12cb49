"""Outputs whose recorded values no simulation within the bounds comes near."""

import numpy as np
import pytest

from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.looks.reach import out_of_reach

N, PERIOD = 400, 0.05
INPUT = np.repeat(np.random.default_rng(0).uniform(-1.0, 2.0, N // 20), 20)


def lag(gain=2.0, tau=0.5, noise=0.02, key=1):
    x, y, a = 0.0, np.empty(N), np.exp(-PERIOD / tau)
    for k, v in enumerate(INPUT):
        y[k] = x
        x = a * x + (1 - a) * gain * v
    return y + noise * np.std(y) * np.random.default_rng(key).normal(size=N)


def looks(y, text="x' = (K*u - x)/tau; y = x", bounds=((0.5, 8.0), (0.1, 2.0)), key=0, unit="m"):
    model = equations(
        text, inputs=["u"], states=["x"], outputs={"y": {"unit": unit}},
        parameters={"K": {"bounds": bounds[0]}, "tau": {"unit": "s", "bounds": bounds[1]}},
    )  # fmt: skip
    record = Recording(PERIOD * np.arange(N), {"u": Signal(INPUT), "y": Signal(y, unit)}, "a")
    return out_of_reach(Problem(model, record), key)


@pytest.mark.parametrize("key", range(8))
def test_a_plant_within_its_bounds_is_left_alone(key):
    rng = np.random.default_rng(key)
    gain, tau = np.exp(rng.uniform(np.log(0.5), np.log(8.0))), np.exp(rng.uniform(np.log(0.1), np.log(2.0)))
    assert not looks(lag(gain, tau, key=key), key=key)


@pytest.mark.parametrize(("factor", "word"), [(100.0, "much"), (60.0, "much"), (0.01, "little"), (1e-3, "little")])
@pytest.mark.parametrize("key", range(3))
def test_a_wrong_unit_of_the_output(factor, word, key):
    (look,) = looks(factor * lag(key=key), key=key)
    assert (look.kind, look.signal) == ("reach", "y")
    assert f"move as {word} as the recorded one" in look.sentence
    assert look.figures["recorded"] == pytest.approx(factor * np.std(lag(key=key)), rel=0.03)
    assert "240 random points" in look.sentence


def test_another_level():
    (look,) = looks(lag() + 273.15, unit="K")
    assert look.kind == "level"
    assert "K in the recording" in look.sentence
    # where the level is free, it may be anything
    assert not looks(lag() + 273.15, "x' = (K*u - x)/tau; y = x + 500*tau", bounds=((0.5, 8.0), (0.1, 2.0)))


def test_the_level_is_counted_from_what_is_recorded_anywhere():
    assert not looks(lag() + 0.5 * np.std(lag()))


def test_an_output_of_noise_alone_has_no_spread():
    assert not looks(1e3 * np.random.default_rng(3).normal(size=N))


def test_a_model_that_runs_away_is_no_wrong_unit():
    # recorded in a closed loop, where nothing runs away; the model alone does
    assert not looks(lag(), "x' = (K*u + x)/tau; y = x", bounds=((0.5, 8.0), (0.3, 2.0)))
    # and with another unit from the first samples on it is one
    (look,) = looks(1e-4 * lag(), "x' = (K*u + x)/tau; y = x", bounds=((0.5, 8.0), (0.3, 2.0)))
    assert look.kind == "reach"


def test_where_few_points_can_be_simulated_nothing_is_told():
    # to infinity within pi/(2 K tau): at most points before the end of the record
    assert not looks(1e3 * lag(), "x' = K*tau*(x^2 + 1) + 0*u; y = x", bounds=((0.5, 8.0), (0.1, 2.0)))
    (look,) = looks(1e3 * lag(), "x' = K*tau*(1e-3*x + 1e-3) + 0*u; y = x", bounds=((0.5, 8.0), (0.1, 2.0)))
    assert look.kind == "reach"


def test_outputs_and_recordings_are_told_apart_with_their_weights():
    model = equations(
        "x' = (K*u - x)/tau; y = x; z = 2*x", inputs=["u"], states=["x"], outputs=["y", "z"],
        parameters={"K": {"bounds": (0.5, 8.0)}, "tau": {"unit": "s", "bounds": (0.1, 2.0)}},
    )  # fmt: skip
    t, y = PERIOD * np.arange(N), lag()
    short = slice(0, N // 4)
    records = {
        "a": Recording(t, {"u": Signal(INPUT), "y": Signal(y), "z": Signal(100 * y)}, "a"),
        "b": Recording(t[short], {"u": Signal(INPUT[short]), "y": Signal(y[short]), "z": Signal(100 * y[short])}, "b"),
    }
    for problem in (Problem(model, records), Problem(model, records, balance="recordings")):
        (look,) = out_of_reach(problem)
        assert "in the recordings. Look at the units of z and of the inputs, and at the bounds." in look.sentence
        assert look.signal == "z"
        assert look.figures["recorded"] == pytest.approx(100 * np.std(y), rel=0.1)


def test_a_static_curve():
    u = np.linspace(0.0, 3.0, 40)
    model = equations("y = K*u/(1 + u)", inputs=["u"], states=[], outputs=["y"], parameters={"K": {"bounds": (1, 4)}})
    for factor in (1.0, 1000.0):
        record = Recording(np.arange(40.0), {"u": Signal(u), "y": Signal(factor * 2.0 * u / (1 + u))}, "a")
        assert len(out_of_reach(Problem(model, record))) == (factor != 1.0)


def test_a_plant_without_inputs_has_one_unit_to_look_at():
    t = PERIOD * np.arange(N)
    model = equations(
        "x' = -x/tau; y = x", inputs=[], states={"x": {"initial": "x0"}}, outputs=["y"],
        parameters={"tau": {"unit": "s", "bounds": (0.5, 5.0)}, "x0": {"bounds": (0.5, 5.0)}},
    )  # fmt: skip
    for factor in (1.0, 1000.0):
        found = out_of_reach(Problem(model, Recording(t, {"y": Signal(factor * 2.0 * np.exp(-t / 3.0))}, "a")))
        assert len(found) == (factor != 1.0)
        assert all("Look at the unit of y, and at the bounds." in look.sentence for look in found)
