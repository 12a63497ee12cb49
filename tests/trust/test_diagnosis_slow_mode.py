"""A slow mode that an input drives is told as that, and not as a drift; a drift is not told as a mode."""

import re

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.diagnosis import diagnose, diagnosis_record

N, GAIN, TIME, NOISE = 900, 0.3, 90.0, 0.01


def told_of(kind, seed, split=0.7):
    """A lag of first order with a second, slow one beside it ("mode"), or something slow that no input drives."""
    rng, t = np.random.default_rng(seed), np.arange(float(N))
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 15), 15)
    x, s, walk = np.zeros(N), np.zeros(N), np.zeros(N)
    steps = 0.02 * rng.standard_normal(N)
    for k in range(N - 1):
        x[k + 1] = u[k] * 2.0 + (x[k] - 2.0 * u[k]) * np.exp(-1 / 5.0)
        s[k + 1] = GAIN * u[k] + (s[k] - GAIN * u[k]) * np.exp(-1 / TIME)
        walk[k + 1] = walk[k] + steps[k]
    slow = {
        "mode": s,
        "sine": 0.1 * np.sin(2 * np.pi * t / 500 + seed),
        "walk": walk,
        "ramp": 3e-4 * t,
        "nothing": 0.0 * t,
    }[kind]
    y = x + slow + NOISE * rng.standard_normal(N)
    model = equations(
        "x' = (K*u - x)/tau\ny = x", inputs={"u": "V"}, states={"x": {"unit": "K", "initial": 0.0}}, outputs={"y": "K"},
        parameters={"K": {"unit": "K/V"}, "tau": {"unit": "s"}},
    )  # fmt: skip
    recording = Recording(t, {"u": Signal(u, "V"), "y": Signal(y, "K")}, "log")
    bounds = {"K": Parameter((0.1, 10.0)), "tau": Parameter((1.0, 100.0), scale="log")}
    answer = fit(Problem(model, recording, bounds, split=split), budget=1000)
    found = diagnose(answer.problem, answer.best.x)
    return found, [s["sentence"] for s in diagnosis_record(found)["verdict"]]


def seeds(*own):
    return [own[0], *(pytest.param(s, marks=pytest.mark.slow) for s in own[1:])]


@pytest.mark.thorough
@pytest.mark.parametrize("split", [0.7, None])
@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4))
def test_a_slow_mode_is_named_with_its_numbers(seed, split):
    found, said = told_of("mode", seed, split)
    assert found.mode is not None
    assert found.drifting is None
    assert found.rival is None
    assert found.mode.time[0] == pytest.approx(TIME, abs=max(4 * found.mode.time[1], 2.0))
    assert found.mode.gain[0] == pytest.approx(GAIN, abs=max(4 * found.mode.gain[1], 0.01))
    assert found.mode.values["K"][0] == pytest.approx(2.0, abs=0.02)
    sentence = next(s for s in said if s.startswith("A slow mode of y that u drives is missing"))
    assert re.search(r"s' = \(g\*u - s\)/T, and add s to y", sentence)
    assert not any("drift" in s for s in said if s != sentence and "Without that slow mode" not in s)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["sine", "walk", "ramp", "nothing"])
@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4))
def test_what_no_input_drives_is_no_slow_mode(kind, seed):
    for split in (0.7, None):
        found, said = told_of(kind, seed, split)
        assert found.mode is None
        assert not any("slow mode" in s for s in said)
