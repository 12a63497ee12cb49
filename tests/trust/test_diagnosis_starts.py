"""Initial values that are off: which measured sample is to blame, and that it is no offset of the sensor."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim, lti

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.trust.diagnosis import diagnose, diagnosis_record
from plantfit.trust.diagnosis.phase import _first_values
from plantfit.trust.intervals.first_values import outputs_begun_at, states_begun_at


def problem(text, initial, recording, bounds):
    states = {s: {"initial": v} for s, v in initial.items()}
    model = equations(text, inputs=["u"], states=states, outputs=["y"], parameters=list(bounds), check=False)
    return Problem(model, recording, {k: Parameter(b, scale="log") for k, b in bounds.items()}, split=0.7)


def steps(seed, n, every=20):
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, n // every + 1), every)[:n]


@pytest.mark.parametrize(
    ("off", "said"), [(["x1"], False), (["x2"], True), (["x1", "x2"], True), (["x3"], True), ([], False)]
)
def test_a_first_sample_is_blamed_for_states_that_begin_at_it_alone(off, said):
    n = 50
    rng = np.random.default_rng(1)
    recording = Recording(np.arange(float(n)), {"u": Signal(steps(1, n)), "y": Signal(rng.normal(size=n))}, "run")
    text = "x1' = (K*u - x1)/20\nx2' = (x1 - x2)/8\nx3' = (x2 - x3)/3\ny = x2 + 0*x3"
    given = problem(text, {"x1": 0.0, "x2": "y", "x3": "2*y + 1"}, recording, {"K": (0.1, 10.0)})
    z = np.array([0.5])
    assert states_begun_at(given, z) == {"y": ("x2", "x3")}
    assert outputs_begun_at(given, z) == ["y"]
    found = [SimpleNamespace(extension=SimpleNamespace(kind="start", signal=s)) for s in off]
    found.append(SimpleNamespace(extension=SimpleNamespace(kind="lag", signal="x2")))
    made: Any = SimpleNamespace(found=found)
    told = list(_first_values(given, z, made))
    assert [("that sample may be wrong" in s["sentence"]) for s in told] == [True] * said


@pytest.mark.parametrize(("seed", "size"), [(8, 1.0), pytest.param(9, 1e-3, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_wrong_first_sample_of_a_plant_that_integrates_is_no_offset_of_the_sensor(seed, size):
    """A shift of all that is simulated follows both the same."""
    n, noise = 400, 0.05 * size
    u = steps(seed, n)
    y = size * (1.0 + 0.2 * np.r_[0.0, np.cumsum(u)[:-1]]) + noise * np.random.default_rng(seed).normal(size=n)
    y[0] = size + 8.0 * noise
    recording = Recording(np.arange(float(n)), {"u": Signal(u), "y": Signal(y)}, "run")
    answer = fit(problem("x' = K*u\ny = x", {"x": "y"}, recording, {"K": (1e-3 * size, size)}))
    d = diagnose(answer.problem, answer.best.x)
    assert [(t.extension.kind, t.extension.signal) for t in d.found] == [("start", "x")]
    assert [t.extension.kind for t in d.rounds[0].found] == ["start"]
    assert d.found[0].value == pytest.approx(-8.0 * noise, rel=0.1)
    said = " ".join(s["sentence"] for s in diagnosis_record(d)["verdict"])
    assert "offset of" not in said


@pytest.mark.slow
@pytest.mark.parametrize("initial", ["y", 0.0])
def test_an_offset_of_the_sensor_stays_one_where_the_plant_settles(initial):
    n = 400
    u, t = steps(5, n), np.arange(float(n))
    y = lsim(lti([2.0], [8.0, 1.0]), u, t, interp=False)[1] + 0.7 + 0.02 * np.random.default_rng(5).normal(size=n)
    recording = Recording(t, {"u": Signal(u), "y": Signal(y)}, "run")
    given = problem("x' = (K*u - x)/tau\ny = x", {"x": initial}, recording, {"K": (0.1, 10.0), "tau": (1.0, 100.0)})
    d = diagnose((answer := fit(given)).problem, answer.best.x)
    assert any(t.extension.kind in ("offset", "input_offset") for t in d.rounds[0].found)


def tank(seed, loss):
    """A tank with an outflow by the root of its level and a constant loss, 1260 of 1800 samples fitted."""
    n, period, noise = 1800, 2.0, 3e-3
    rng = np.random.default_rng(seed)
    u, h = np.repeat(rng.uniform(0.0, 1.0, n // 100), 100), np.empty(n)
    h[0] = 0.6
    for k in range(n - 1):
        x = h[k]
        for _ in range(4):
            middle = x + 0.125 * period * (0.15 * u[k] - loss - 0.06 * np.sqrt(x)) / 50.0
            x += 0.25 * period * (0.15 * u[k] - loss - 0.06 * np.sqrt(middle)) / 50.0
        h[k + 1] = x
    y = h + noise * rng.normal(size=n)
    return Recording(np.arange(n) * period, {"u": Signal(u), "y": Signal(y)}, "tank")


@pytest.mark.parametrize("seed", [2, pytest.param(1, marks=pytest.mark.slow), pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_what_explains_alike_is_judged_with_its_own_first_values(seed):
    """Where the fit without the loss has put the first value, a change that bends to it explains more than the loss."""
    given = problem(
        "h' = (k*u - c*sqrt(max(h, 0)))/50\ny = h", {"h": "y"}, tank(seed, 0.02), {"k": (1e-2, 10.0), "c": (1e-3, 1.0)}
    )
    d = diagnose((answer := fit(given)).problem, answer.best.x, rounds=1)
    named = {t.extension.name: t for t in d.rounds[0].found}
    assert named["offset of u"].value == pytest.approx(0.02 / 0.15, abs=0.004)
    assert named["offset of u"].rmse[1] == pytest.approx(3e-3, rel=0.05)
