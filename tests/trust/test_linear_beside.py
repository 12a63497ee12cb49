"""A model of first order on a plant that oscillates: no addition explains it, and the best linear model says what
does."""

import re

import numpy as np
import pytest
from scipy.signal import lsim, lti

from plantfit import Parameter, Problem, Recording, Signal, equations, fit

FIRST = "x' = (K*u - x)/tau\ny = x"
OWN = {"K": Parameter((0.01, 100.0), scale="log"), "tau": Parameter((0.01, 100.0), scale="log")}


def record(seed, omega, damping, gain=2.0, noise=0.02, n=600, curve=lambda y: y):
    """Steps of random length into gain/(s^2/omega^2 + 2 damping s/omega + 1), sampled every 0.1 s."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(n)
    u = np.repeat(rng.choice([-1.0, 0.0, 1.0, 2.0], size=n // 20), 20)
    _, y, _ = lsim(lti([gain], [1 / omega**2, 2 * damping / omega, 1.0]), u, t, interp=False)
    y = curve(y) + noise * np.ptp(y) * rng.standard_normal(n)
    return Recording(t, {"u": Signal(u, "V"), "y": Signal(y, "m")}, "run")


def told(text, recording, parameters, split=0.7, whole=False):
    model = equations(
        text,
        inputs={"u": "V"},
        states=re.findall(r"(\w)' =", text),
        outputs={"y": "m"},
        parameters=list(parameters),
        check=False,
    )
    answer = fit(Problem(model, recording, parameters, split=split), budget=1000, seed=1)
    found = answer.diagnose(whole=whole)
    return answer, [s for s in found["verdict"] if s["sentence"].startswith("A linear model")] if found else []


@pytest.mark.parametrize(
    ("omega", "damping"), [*(pytest.param(*p, marks=pytest.mark.slow) for p in ((1.2, 0.17), (3.0, 0.4))), (0.7, 0.05)]
)
@pytest.mark.thorough
def test_an_oscillation_is_named_and_what_to_write_reaches_the_noise(omega, damping):
    recording = record(3, omega, damping)
    _, said = told(FIRST, recording, OWN)
    (one,) = said
    assert one["level"] == "warning"
    period, zeta = (
        float(v) for v in re.findall(r"period of ([\d.]+) s and a damping ratio of ([\d.]+),", one["sentence"])[0]
    )
    assert period == pytest.approx(2 * np.pi / (omega * np.sqrt(1 - damping**2)), rel=0.03)
    assert zeta == pytest.approx(damping, rel=0.15)
    start = float(re.findall(r"T is about ([\d.]+) s\.", one["sentence"])[0])
    assert start == pytest.approx(1 / (2 * damping * omega), rel=0.15)
    better = {**OWN, "T": Parameter((start / 20, start * 20), scale="log")}
    answer, again = told("x' = v\nv' = ((K*u - x)/tau - v)/T\ny = x", recording, better)
    assert again == []
    assert answer.values["K"] == pytest.approx(2.0, rel=0.02)
    assert all(r["white"] for r in answer.findings["residual_tests"])


@pytest.mark.thorough
def test_a_gain_of_the_other_sign_is_named():
    recording = record(5, 20.0, 5.0, gain=-3.0)
    # a run asks for the column first, and leaves it there
    answer, said = told(FIRST, recording, OWN)
    assert said == []
    [column] = [s["sentence"] for s in answer.findings["verdict"] if "the model follows the record" in s["sentence"]]
    # noise decides which of them is the first
    alike = re.match(
        r"With the other sign of ([uy]) or the other sign of ([uy]) the model follows the record, ", column
    )
    assert alike is not None
    first, second = alike.groups()
    assert first != second
    assert (
        ": the record does not tell which of them is wrong. Look at them, and for the first write clean = [{" in column
    )
    assert (
        f'signal = "{first}", factor = -1.0 }}] under [recording.run] (after its other steps, if it has any)' in column
    )
    _, (one,) = told(FIRST, recording, OWN, whole=True)
    assert float(re.findall(r"Its static gain from u is (-[\d.]+); see", one["sentence"])[0]) == pytest.approx(
        -3.0, rel=0.02
    )


@pytest.mark.thorough
def test_a_disturbance_that_another_state_imitates_on_fitted_samples_is_no_state():
    slow = record(6, 20.0, 5.0, noise=0.005)
    y = slow["y"] + 3.0 * np.sin(2 * np.pi * slow.t / 150.0)
    _, said = told("x' = (K*u - x)/tau\ny = x + c",
                   Recording(slow.t, {"u": Signal(slow["u"], "V"), "y": Signal(y, "m")}, "run"),
                   {**OWN, "c": Parameter((-10.0, 10.0))})  # fmt: skip
    assert said == []


@pytest.mark.parametrize("kind", ["right", "curved", "lagged"])
@pytest.mark.further(1)
def test_where_a_linear_model_does_not_say_it_nothing_is_said(kind):
    if kind == "curved":  # a linear model leaves as much
        recording = record(4, 20.0, 1.0, curve=lambda y: y + 0.8 * y**2)
    else:
        recording = record(4, 20.0 if kind == "right" else 1.5, 1.0 if kind == "right" else 1.2)
    _, said = told(FIRST, recording, OWN)
    assert said == []  # a further lag is among the additions and explains it


@pytest.mark.parametrize("period", [4.7, 11.0])
@pytest.mark.thorough
def test_a_swing_that_no_input_moves_is_no_state_of_the_plant(period):
    """A sine acts on a lag of first order. "What is missing is mostly linear; write one more state" is wrong: the
    linear model swings from its own initial states throughout."""
    recording = record(7, 20.0, 5.0, noise=0.005)
    y = recording["y"] + 0.7 * np.sin(2 * np.pi * recording.t / period + 1.0)
    _, said = told(FIRST, Recording(recording.t, {"u": Signal(recording["u"], "V"), "y": Signal(y, "m")}, "run"), OWN)
    (one,) = said
    assert one["level"] == "warning"
    assert "mostly linear" not in one["sentence"]
    assert "write one more" not in one["sentence"]
    found = float(re.findall(r"a swing with a period of ([\d.]+) s that lasts throughout", one["sentence"])[0])
    assert found == pytest.approx(period, rel=0.01)
    assert "no input moves. Something that comes back acts on the plant" in one["sentence"]


@pytest.mark.thorough
def test_a_swing_that_inputs_move_is_one_of_the_plant_however_little_it_fades():
    _, (one,) = told(FIRST, record(3, 3.0, 0.002), OWN)
    assert "no input moves" not in one["sentence"]
    assert "It oscillates with a period of 2.09 s" in one["sentence"]


TWO_MASSES = "x' = (P - (x - Ta)/R)/C\ny = x"


def masses(second=60.0, between=2.0):
    """The matrix of the states."""
    return np.array(
        [[-(1.0 + 1.0 / between) / 200, 1.0 / between / 200], [1.0 / between / second, -1.0 / between / second]]
    )


def two_masses(seed, size=1.0, level=20.0, second=60.0, between=2.0, n=600):
    """A heated mass with a second one that hangs on it, 10 s a sample; temperatures are `size` times as large about a
    `level`, which the surroundings keep."""
    rng = np.random.default_rng(seed)
    t = 10.0 * np.arange(n)
    waves = [9.0 * np.sin(2 * np.pi * t / w + p) for w, p in zip((500, 860, 260), rng.uniform(0, 6, 3), strict=True)]
    power = 30.0 + np.sum(waves, axis=0)
    plant = (masses(second, between), np.array([[1.0 / 200], [0.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    y = size * (lsim(plant, power, t, interp=False)[1] + 0.1 * rng.standard_normal(n)) + level
    signals = {"P": Signal(power, "W"), "Ta": Signal(np.full(n, level), "degC"), "y": Signal(y, "degC")}
    return Recording(t, signals, "run")


@pytest.mark.parametrize(
    ("seed", "size", "level"),
    [(4, 1.0, 20.0), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((5, 30.0, -10.0), (6, 0.1, 300.0)))],
)
@pytest.mark.thorough
def test_a_second_mass_that_is_missing_is_no_cause_that_looks_like_it(seed, size, level):
    model = equations(
        TWO_MASSES,
        inputs={"P": "W", "Ta": "degC"},
        states={"x": {"unit": "degC", "initial": "y"}},
        outputs={"y": "degC"},
        parameters=["R", "C"],
        check=False,
    )
    parameters = {"R": Parameter((0.01, 100.0), scale="log"), "C": Parameter((1.0, 1e5), scale="log")}
    answer = fit(Problem(model, two_masses(seed, size, level), parameters, split=0.7), budget=1000, seed=1)
    made = answer.diagnose()
    assert made is not None
    said = [s["sentence"] for s in made["verdict"]]
    linear = [s for s in said if s.startswith("A linear model of order 2")]
    mode = [s for s in said if s.startswith("A slow mode of y that P drives is missing")]
    assert len(linear) + len(mode) == 1
    for text in linear:
        assert text.endswith("what is missing is mostly linear. The model has 1 state; write one more.")
    for text in mode:  # with values of parts side by side, which are not the plant's
        assert "a second mass that takes up heat. Write a state for it: s' = (g*P - s)/T" in text
        assert text.endswith("the equations of both give other values.")
        slow = float(re.findall(r"a time constant of ([\d.]+)", text)[0])
        assert slow == pytest.approx(-1.0 / min(np.linalg.eigvals(masses())), rel=0.25)
    assert not any("likely missing" in s or "from Ta" in s for s in said)
    rest = [s for s in said if s not in mode and "explains" in s and " of what is " in s and "RMSE" in s]
    assert all("it may stand for that" in s for s in rest)


CONVERTER = "i' = (12*d - r*i - v)/L; v' = (i - v/2)/C; out = v"


def converter(seed, series, n=1500):
    """The output of a buck converter, every 2 us: 22 uH, 47 uF with a resistance in `series` (Ohm), a load of 2 Ohm."""
    rng, share = np.random.default_rng(seed), 1.0 / (1.0 + series / 2.0)
    duty, t = np.repeat(rng.uniform(0.2, 0.8, n // 100), 100), 2e-6 * np.arange(n)
    a = np.array([[(-0.05 - share * series) / 22e-6, -share / 22e-6], [share / 47e-6, -share / 94e-6]])
    plant = (a, np.array([[12.0 / 22e-6], [0.0]]), np.array([[share * series, share]]), np.zeros((1, 1)))
    out = lsim(plant, duty, t, interp=False)[1] + 0.01 * rng.standard_normal(n)
    return Recording(t, {"d": Signal(duty), "out": Signal(out, "V")}, "run")


@pytest.mark.parametrize(
    ("seed", "series", "alike"), [(1, 0.08, True), pytest.param(2, 0.3, False, marks=pytest.mark.slow)]
)
def test_how_a_signal_enters_is_named_where_the_states_swing_as_they_should(seed, series, alike):
    model = equations(
        CONVERTER, inputs={"d": "1"}, states={"i": "A", "v": "V"}, outputs={"out": "V"}, parameters=list("rLC"),
        check=False,
    )  # fmt: skip
    own = {"r": Parameter((1e-3, 1.0)), **{n: Parameter((1e-6, 1e-3), scale="log") for n in "LC"}}
    found = fit(Problem(model, converter(seed, series), own, split=0.7), seed=1).diagnose()
    assert found is not None
    (one,) = (s["sentence"] for s in found["verdict"] if s["sentence"].startswith("A linear model"))
    assert ("as this model does. So its states are right: what is missing is how inputs" in one) == alike
    assert "what is missing is how inputs or outputs enter, as an output that an input or a rate acts on" in one
    assert ("this model, with the values that were found, with 0.0" in one) == (not alike)
    assert found["next"] == ""


def test_where_values_keep_a_model_from_swinging_it_says_so():
    """Two states that their bounds hold apart: they could swing, and do not."""
    text = "x' = v; v' = (K*u - x - tau*v)/w; y = x"
    bounds = {"K": Parameter((0.01, 100.0), scale="log"), "tau": Parameter((3.0, 10.0)), "w": Parameter((0.01, 0.5))}
    _, (one,) = told(text, record(3, 1.2, 0.17), bounds)
    assert "; this model does not, with the values that were found." in one["sentence"]
