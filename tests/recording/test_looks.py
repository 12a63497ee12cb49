"""Looks at signals: each where it is true, and where a plain record must be left alone."""

import tomllib

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.recording.looks import clock_looks, feedback_look, signal_looks
from plantfit.recording.record import Recording, Signal

T = np.arange(600) * 0.05


def plant(u, noise=0.02, seed=0, start=0.0):
    """A first order plant, gain 2, 0.5 s, under an input held between samples; noise as a share of its spread."""
    x, y, a = start, np.empty(len(u)), np.exp(-0.05 / 0.5)
    for k, v in enumerate(u):
        y[k] = x
        x = a * x + (1 - a) * 2.0 * v
    return y + noise * np.std(y) * np.random.default_rng(seed).normal(size=len(u))


def steps(seed=0, held=20):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 2, 600 // held), held)


def recorded(y, u=None, t=T):
    return Recording(t, {"u": Signal(steps() if u is None else u, "V"), "y": Signal(y, "m")}, "a")


def kinds(y, measured=True):
    return [look.kind for look in signal_looks(recorded(y), "y", measured)]


@pytest.mark.parametrize("seed", range(20))
def test_a_plain_record_is_left_alone(seed):
    r = recorded(plant(steps(seed), seed=seed), steps(seed))
    assert not list(signal_looks(r, "y", measured=True))
    assert not list(signal_looks(r, "u", measured=False))
    assert not list(clock_looks(r))
    assert feedback_look(r, "u", "y") is None


def test_records_without_noise_and_signals_with_sharp_corners_are_left_alone():
    assert not kinds(plant(steps(), noise=0.0))
    assert not kinds(np.abs(np.sin(T)) + 0.001 * np.random.default_rng(0).normal(size=600))
    assert not kinds(steps(), measured=False)  # an input rests at its ends


def test_a_signal_that_never_moves():
    (look,) = signal_looks(recorded(plant(steps()), np.full(600, 1.5)), "u", measured=False)
    assert look.kind == "constant"
    assert look.figures["value"] == 1.5
    assert "1.5 V" in look.sentence


def test_a_sensor_that_ends():
    y = plant(steps())
    level = np.quantile(y, 0.9)
    (look,) = signal_looks(recorded(np.minimum(y, level)), "y", measured=True)
    assert look.kind == "clipped"
    assert look.figures["value"] == pytest.approx(level)
    assert "upper end" in look.sentence
    assert "sensor_high" in look.write
    assert y[np.searchsorted(T, look.begin)] >= level - 0.1


def test_a_sensor_that_is_stuck():
    y = plant(steps())
    y[300:350] = y[300]
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert look.kind == "stuck"
    assert (look.begin, look.figures["samples"]) == (pytest.approx(15.0), 50)


def test_a_coarse_sensor_is_quantised_and_neither_stuck_nor_clipped():
    y = np.round(plant(steps(), noise=0.05) / 0.2) * 0.2
    found = list(signal_looks(recorded(y), "y", measured=True))
    assert [look.kind for look in found] == ["quantised"]
    assert found[0].figures["step"] == pytest.approx(0.2)


def test_spikes_are_counted_and_placed():
    y = plant(steps())
    at = [100, 250, 251 + 90, 500]
    y[at] += 2.0
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert look.kind == "spikes"
    assert look.figures["samples"] == 4
    assert (look.begin, look.end) == (pytest.approx(T[100]), pytest.approx(T[500]))
    (step,) = tomllib.loads(look.write)["clean"]
    options = {k: v for k, v in step.items() if k not in ("step", "signal")}
    cleaned = getattr(rec, step["step"])(recorded(y), step["signal"], **options)
    assert np.flatnonzero(np.isnan(cleaned["y"])).tolist() == at


def test_missing_samples_in_a_row():
    y = plant(steps())
    y[200:240] = np.nan
    (look,) = signal_looks(recorded(y), "y", measured=True)
    assert (look.kind, look.figures["samples"], look.begin) == ("missing", 40, pytest.approx(10.0))


def test_gaps_and_an_uneven_clock():
    kept = np.r_[0:200, 260:600]
    (gap,) = clock_looks(recorded(plant(steps())[kept], steps()[kept], T[kept]))
    assert gap.kind == "gaps"
    assert gap.figures["longest"] == pytest.approx(3.05)
    uneven = T + 0.02 * np.random.default_rng(1).uniform(-1, 1, 600)
    (look,) = clock_looks(recorded(plant(steps()), t=uneven))
    assert look.kind == "irregular"


def test_an_input_computed_from_the_output():
    rng, x, a = np.random.default_rng(0), 0.0, np.exp(-0.05 / 0.5)
    u, y, goal = np.empty(600), np.empty(600), steps(3)
    for k in range(600):
        y[k] = x + 0.05 * rng.normal()
        u[k] = 3.0 * (goal[k] - (y[k - 1] if k else 0.0))
        x = a * x + (1 - a) * 2.0 * u[k]
    look = feedback_look(recorded(y, u), "u", "y")
    assert look is not None
    assert look.kind == "feedback"
    assert (look.figures["share"] or 0.0) > 0.05
    noisy = recorded(plant(np.random.default_rng(5).normal(size=600)), np.random.default_rng(5).normal(size=600))
    assert feedback_look(noisy, "u", "y") is None


def test_a_blip_of_one_level_of_a_coarse_signal_is_no_spike():
    y = np.round(plant(steps()) / 0.25) * 0.25
    flat = int(np.argmax(np.convolve(np.diff(y) == 0, np.ones(10), "valid"))) + 5
    y[flat] += 0.25
    assert "spikes" not in kinds(y)
    y[flat] += 5.0
    [look] = [k for k in signal_looks(recorded(y), "y", True) if k.kind == "spikes"]
    assert look.sentence.startswith("1 sample of y stands alone")
    assert look.times == [T[flat]]


def test_clipped_samples_are_marked():
    y = np.minimum(plant(steps()), 2.0)
    [look] = [k for k in signal_looks(recorded(y), "y", True) if k.kind == "clipped"]
    assert len(look.times) == min(200, int(look.figures["samples"] or 0))
    assert all(y[np.isclose(T, at)] == 2.0 for at in look.times)
