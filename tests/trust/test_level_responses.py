"""Steps are judged by their response beside the drift, against steps and drifts that are known."""

import numpy as np
import pytest

from plantfit.recording.record import Recording, Signal
from plantfit.trust.validate.level_responses import level_responses

GAINS = (40.0, 1.0, -30.0)


def plant(swing, noise=0.0):
    """First order, 30 s, levels of 800 s, a supply that swings by +- `swing` degC with a period of 350 s."""
    t = np.arange(0.0, 3200.0, 2.0)
    level = (t // 800.0).astype(int)
    u = np.array([0.4, 0.55, 0.7, 0.85])[level]
    settled = 30.0 + np.concatenate([[0.0], np.cumsum(0.15 * np.array(GAINS))])[level]
    y, out = settled[0], []
    for goal in settled:
        y += (goal - y) * (1 - np.exp(-2.0 / 30.0))
        out.append(y)
    values = (
        np.array(out) + swing * np.sin(2 * np.pi * t / 350.0) + noise * np.random.default_rng(3).standard_normal(len(t))
    )
    return Recording(t, {"u": Signal(u, "V"), "y": Signal(values, "degC")}, "plant")


def test_response_and_drift_are_those_of_the_plant():
    found = level_responses(plant(swing=0.5), "u", "y")
    assert [round(f.level, 2) for f in found] == [0.55, 0.7, 0.85]
    assert [f.start for f in found] == [800.0, 1600.0, 2400.0]
    for f, gain in zip(found, GAINS, strict=True):
        assert f.response == pytest.approx(0.15 * gain, abs=0.25)  # a half-level is 1.14 periods
        assert f.drift == pytest.approx(1.0, rel=0.1)  # from -0.5 to 0.5


def test_only_steps_over_twice_the_drift_are_told():
    found = level_responses(plant(swing=0.5), "u", "y")
    assert [f.told for f in found] == [True, False, True]
    assert "neither its gain nor its dead time can be told" in found[1].sentence
    assert found[0].sentence.endswith("the step shows.")


def test_without_drift_the_small_step_is_told_too_and_white_noise_is_no_drift():
    assert all(f.told for f in level_responses(plant(swing=0.0), "u", "y"))
    noisy = level_responses(plant(swing=0.0, noise=0.05), "u", "y")
    assert all(f.told for f in noisy)
    assert max(f.drift for f in noisy) < 0.1
