"""Residuals that noise of the sensor may have left are not called a fault of the model; those of wrong models are."""

import numpy as np
import pytest
from scipy.signal import lfilter

import plantfit as pf
from plantfit.trust.verdict.estimators.correlated import may_be_noise, weighted_sentences
from plantfit.trust.verdict.residuals import noise_sentences, residual_sentences


def oven(seed, correlation, wrong=None, n=500):
    """A first-order oven with noise of 0.8 degC, and what its model lacks, if anything."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([20.0, 40.0, 60.0, 80.0], size=n // 20), 20)
    heat, slower = u, np.exp(-1 / 8.0)
    if wrong == "second lag":
        heat = np.r_[0.0, lfilter([1 - slower], [1, -slower], u)[:-1]]
    if wrong == "saturation":
        heat = np.minimum(u, 60.0)
    if wrong == "hidden input":
        heat = u + np.repeat(rng.choice([0.0, 6.0], size=n // 35 + 1), 35)[:n]
    p = np.exp(-1 / 30.0)
    x = np.r_[0.0, lfilter([1.7 * (1 - p)], [1, -p], heat)[:-1]]
    x = x + (np.linspace(0.0, 4.0, n) if wrong == "drift" else 0.0)
    e = np.sqrt(1 - correlation**2) * lfilter([1.0], [1.0, -correlation], rng.normal(size=n + 500))[500:]
    model = pf.equations(
        "x' = (K*u - x)/tau\ny = x + c", inputs=["u"], states={"x": {"initial": 0}}, outputs=["y"],
        parameters=["K", "tau", "c"],
    )  # fmt: skip
    recording = pf.Recording(np.arange(n) * 1.0, {"u": pf.Signal(u), "y": pf.Signal(x + 22.0 + 0.8 * e)}, "oven")
    bounds = {"K": (0.1, 10), "tau": (1, 300), "c": (0, 50)}
    return pf.Problem(model, recording, bounds, hold={"u": "previous"})


def told(problem, seed=0, diagnosed=False):
    answer = pf.fit(problem, runs=1, seed=seed)
    if diagnosed:
        answer.diagnose()
    return answer, " ".join(s["sentence"] for s in answer.findings["verdict"])


def named(answer):
    return any(r["found"] for r in answer.findings["diagnosis"]["rounds"])


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_noise_of_a_sensor_is_no_fault_of_the_model(seed):
    answer, said = told(oven(seed, 0.7), seed, diagnosed=True)
    assert not named(answer)
    assert "Noise that is correlated would leave the same" in said
    assert "by noise that is correlated or by what the model lacks" in said
    assert "systematic is missing" not in said
    assert "better model could still gain" not in said
    assert "Not all that is left is noise" not in said


@pytest.mark.parametrize("wrong", ["second lag", pytest.param("drift", marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_what_a_model_lacks_is_not_called_noise(wrong):
    answer, said = told(oven(3, 0.5, wrong), 3, diagnosed=True)
    assert named(answer)
    assert "systematic is missing" in said
    assert "would leave the same" not in said
    assert "If it is noise" not in said


def test_before_additions_were_tried_nobody_says_that_it_is_noise():
    said = told(oven(0, 0.7))[1]
    assert "systematic is missing" in said
    assert "would leave the same" not in said


@pytest.mark.slow
def test_over_many_records_right_models_are_cleared_and_wrong_ones_are_not():
    """Twelve records each: noise of correlation 0.4 to 0.8 on right models; of white and correlated noise on wrong
    ones."""
    cleared = ["would leave the same" in told(oven(s, 0.4 + 0.1 * (s % 5)), s, diagnosed=True)[1] for s in range(12)]
    assert sum(cleared) >= 10
    for wrong in ("second lag", "saturation", "hidden input", "drift"):
        said = [told(oven(s, (0.0, 0.5, 0.7)[s % 3], wrong), s, diagnosed=True)[1] for s in range(12)]
        assert sum("would leave the same" in s for s in said) <= 1


def test_white_residuals_have_no_such_section():
    answer, said = told(oven(1, 0.0))
    assert answer.findings["correlated"] is None
    assert "are white" in said
    assert "correlated" not in said


def test_the_figures_are_those_of_estimate():
    answer, _ = told(oven(3, 0.85), 3)
    other = pf.estimate_parameters(answer, methods=["generalised least squares"])
    own = {p["name"]: p for p in answer.findings["correlated"]["parameters"]}
    for p in other.typed.parameters:
        of = p.estimates["generalised least squares"]
        assert own[p.name]["value"] == pytest.approx(of.value, rel=1e-12)
        assert own[p.name]["low"] == pytest.approx(of.low, rel=1e-12)


def straight_line(seed, lacking):
    """White noise of one input and a slow part of it that acts once more: least squares finds another slope than
    weighted least squares."""
    rng = np.random.default_rng(seed)
    slow = lfilter([1.0], [1.0, -0.97], rng.normal(size=900))[500:] / 4.0
    x = slow + rng.normal(size=400)
    y = 2.0 * x + 1.0 + lacking * slow + 0.3 * lfilter([1.0], [1.0, -0.7], rng.normal(size=900))[500:]
    model = pf.equations("y = a*x + b", inputs=["x"], outputs=["y"], parameters=["a", "b"])
    recording = pf.Recording(0.1 * np.arange(400), {"x": pf.Signal(x), "y": pf.Signal(y)}, "run")
    return pf.Problem(model, recording, {"a": (-10, 10), "b": (-10, 10)})


@pytest.mark.thorough
def test_what_moves_the_parameters_is_not_all_noise():
    said = [told(straight_line(seed, 0.6))[1] for seed in range(12)]
    assert sum("Not all that is left is noise: weighted for its correlation, a would be " in s for s in said) >= 6
    right = [told(straight_line(seed, 0.0))[1] for seed in range(12)]
    assert sum("Not all that is left is noise" in s for s in right) <= 1


# -- sentences from records -------------------------------------------------------------------------

NOISE = {
    "output": "y", "unit": "V", "deviation": 0.1, "order": 1, "correlation": 0.8, "samples": 400, "independent": 50.0,
    "left": 0.01, "shared": None, "form": None,
}  # fmt: skip


def findings(*, noise=None, weighted=None, rows=None, **changed):
    test = {"recording": "a", "output": "y", "white": False, "autocorrelation": [1.0, 0.8], "p_value": 0.0, "cross": {}}
    rng = np.random.default_rng(0)
    e = lfilter([1.0], [1.0, -0.9], rng.normal(size=300))
    output = {"unit": "V", "measured": e.tolist(), "simulated": np.zeros(300).tolist(), "part": ["fit"] * 300}
    found = {
        "recordings": [{"name": n, "outputs": {"y": output}} for n in (rows or ["a"])],
        "residual_tests": [{**test, "recording": n} for n in (rows or ["a"])],
        "parameters": [{"name": "k", "unit": "V", "value": 2.0, "low": 1.8, "high": 2.2, "status": "determined"}],
        "correlated": {
            "noise": [{**NOISE, **(noise or {})}],
            "parameters": [{"name": "k", "unit": "V", "value": 2.1, "low": 2.05, "high": 2.15}],
            "p": 0.4, "moved": "k", "differs": False, **(weighted or {}),
        },
        "diagnosis": {"rounds": [{"found": []}]},
    }  # fmt: skip
    return {**found, **changed}


def sentences(found):
    return [s["sentence"] for made in (residual_sentences, noise_sentences) for s in made(found)]


def test_all_three_sentences_of_noise_and_their_level():
    found = findings()
    first, second = residual_sentences(found)
    assert first["level"] == second["level"] == "info"
    assert first["sentence"].endswith(
        "standard errors allow for it. Noise that is correlated would leave the same: weighted for it, the parameters "
        "stay where they are (p = 0.4)."
    )
    assert second["sentence"] == (
        "If it is noise, generalised least squares knows more: k = 2.100 ± 0.026 V "
        '(`plantfit estimate --method "generalised least squares"`).'
    )
    assert sentences(found)[2].endswith("by noise that is correlated or by what the model lacks.")
    many = sentences(findings(rows=list("abcde")))
    assert "Noise that is correlated would leave the same" in many[0]
    assert many[-1].endswith("correlated noise, or what the model lacks.")


@pytest.mark.parametrize(
    "why",
    [
        {"noise": {"independent": 7.0}},
        {"noise": {"samples": 4000, "independent": 190.0}},
        {"noise": {"left": 0.3}},
        {"noise": {"order": 0}},
        {"weighted": {"p": None}},
        {"weighted": {"p": 0.001, "differs": True}},
        {"determined": {"sound": False}},
        {"heterogeneity": {"agree": False}},
        {"diagnosis": {"rounds": [{"found": ["a lag"]}]}},
        {"diagnosis": None},
        {"correlated": None},
    ],
)
def test_where_it_may_not_be_noise_the_model_is_asked(why):
    said = " ".join(sentences(findings(**why)))
    assert "would leave the same" not in said
    assert "If it is noise" not in said
    assert "something systematic is missing" in said


def test_what_a_record_shows_of_an_input_is_no_noise():
    cross = {"u": {"lags_s": [], "values": [], "bound": 0.1, "independent": False, "explained": 0.9}}
    found = findings()
    found["residual_tests"][0]["cross"] = cross
    said = " ".join(sentences(found))
    assert "the model's response to it is incomplete" in said
    assert "would leave the same" not in said


def test_a_parameter_that_moves_is_named_with_both_values():
    [said] = weighted_sentences(findings(weighted={"p": 0.0004, "differs": True}, diagnosis=None), ["y"])
    assert said["level"] == "warning"
    assert said["sentence"] == (
        "Not all that is left is noise: weighted for its correlation, k would be 2.1 V in place of 2 (p = 0.0004); "
        "the model lacks something that moves its parameters."
    )
    slow = findings(weighted={"p": 0.0004, "differs": True}, noise={"independent": 5.0})
    assert list(weighted_sentences(slow, ["y"])) == []  # too slow to be taken for noise at all
    assert not may_be_noise(slow, "y")


def test_intervals_that_are_hardly_shorter_get_no_sentence():
    longer = findings()
    longer["correlated"]["parameters"][0] |= {"low": 1.9, "high": 2.3}
    assert list(weighted_sentences(longer, ["y"])) == []
