"""What the verdict says of an answer by a filter, on findings made by hand: each sentence where it is true, and where
it must not appear."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.trust.validate.residuals.ahead import pattern_ahead
from plantfit.trust.verdict.estimators.correlated import weighted_sentences
from plantfit.trust.verdict.estimators.filtered import filtered_sentences, wandering_sentences
from plantfit.trust.verdict.fit import fit_sentences
from plantfit.trust.verdict.residuals import lacking, noise_sentences
from plantfit.trust.verdict.unseen import failing, unseen_sentences

ODD = "it is not noise alone"
DIFFERS = "Least squares, which takes all of it for noise of the sensors, differs by more than chance"
HINT = "Noise that moves the plant itself"


def findings(
    *, process=0.3, consistent=True, differs=False, p=0.4, shared=None, likely=None, ahead=1.0, white=False, fit=40.0
):
    """Of one output y, whose simulation is followed to `fit` percent; unseen samples are `ahead` times as far off one
    sample ahead, and three times in a simulation."""
    rng = np.random.default_rng(1)
    slow = np.convolve(rng.normal(size=400), np.ones(20) / 20, "same") + 0.02 * rng.normal(size=400)
    score = {"recording": "run", "output": "y", "unit": "K", "bias": 0.0, "n": 200}
    test = {"recording": "run", "output": "y", "shared": shared, "p_value": p, "white": p > 0.01, "cross": {}}
    row = {"name": "a", "unit": None, "value": 2.0, "standard_error": 0.1, "low": 1.8, "high": 2.2}
    part = ["fit"] * 200 + ["validation"] * 200
    return {
        "recordings": [
            {"name": "run", "outputs": {"y": {"part": part, "measured": slow, "simulated": 0 * slow, "unit": "K"}}}
        ],
        "scores": [
            score | {"part": "fit", "rmse": 0.2, "fit_percent": fit, "spare": 190.0},
            score | {"part": "validation", "rmse": 0.6, "fit_percent": 20.0},
        ],
        "residual_tests": [test | {"white": white, "p_value": 0.5 if white else 1e-9, "autocorrelation": [1.0, 0.9]}],
        "parameters": [row | {"status": "determined"}],
        "standard_errors": {"kind": "robust", "in_time": True, "estimator": "ekf", "filterable": True},
        "diagnosis": {"rounds": [{"found": ["drift of y"] if likely else [], "likely": likely}]},
        "filtered": {
            "estimator": "ekf",
            "noise": [
                {"kind": "process", "name": "x", "unit": "K/s^0.5", "value": process},
                {"kind": "measurement", "name": "y", "unit": "K", "value": 0.02},
            ],
            "filter": {
                "method": "EKF",
                "nis": {"consistent": consistent, "sentence": "The innovations are large."},
            },
            "p": 1e-4 if differs else 0.5,
            "moved": "a",
            "differs": differs,
            "least_squares": [row | {"low": 1.6, "high": 2.4}],
            "tests": [test],
            "ahead": [
                {"recording": "run", "output": "y", "unit": "K", "part": "fit", "n": 200, "rmse": 0.05},
                {"recording": "run", "output": "y", "unit": "K", "part": "validation", "n": 200, "rmse": 0.05 * ahead},
            ],
        },
    }


def text(sentences):
    return " ".join(s["sentence"] for s in sentences)


def test_whose_parameters_these_are():
    said = text(filtered_sentences(findings()))
    assert said == (
        "The parameters are those of the extended Kalman filter, with noise that moves the plant (0.3 K/s^0.5 of x) "
        "beside that of the sensors (0.02 K of y); intervals are 0.5 (a) times as long as by least squares."
    )
    rests = text(filtered_sentences(findings(process=0.0)))
    assert "noise of the sensors (0.02 K of y) alone: the recordings ask for none that moves the plant" in rests
    assert list(filtered_sentences({**findings(), "filtered": None})) == []


def test_a_difference_and_innovations_of_another_size_are_told_where_they_are():
    assert DIFFERS not in text(filtered_sentences(findings()))
    assert f"{DIFFERS} (p = 0.0001), most in a: 2." in text(filtered_sentences(findings(differs=True)))
    assert "innovations" not in text(filtered_sentences(findings()))
    assert "EKF: The innovations are large." in text(filtered_sentences(findings(consistent=False)))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({}, False),
        ({"likely": "possibly"}, False),
        ({"likely": "likely"}, True),
        ({"likely": "very likely", "process": 0.0}, False),
    ],
)
def test_noise_that_stands_for_a_fault_is_told_where_the_fault_is_likely(change, told):
    assert (ODD in text(filtered_sentences(findings(**change)))) == told


@pytest.mark.parametrize(
    ("change", "told"),
    [({}, True), ({"process": 0.0}, False), ({"white": True}, False), ({"shared": "slot"}, False)],
)
def test_residuals_of_a_plant_that_wanders_are_told_as_that(change, told):
    made = findings(**change)
    said = text(wandering_sentences(made))
    assert ("as a plant leaves them that noise moves" in said) == told
    assert ("y" in lacking(made)) == (not told and not change.get("white") and not change.get("shared"))
    explained = not change or "white" in change
    assert ("better model could still gain" in text(noise_sentences(made))) == (not explained)


def test_errors_that_are_hardly_white_are_not_called_white():
    assert "these errors are white (p = 0.4)" in text(wandering_sentences(findings()))
    hardly = text(wandering_sentences(findings(p=0.002)))
    assert "these errors are white but for what chance leaves in one of some hundred records (p = 0.002)" in hardly


@pytest.mark.parametrize(
    ("ahead", "end"), [(1.1, "it holds."), (1.5, "it holds in part."), (2.5, "it does not hold there.")]
)
def test_unseen_samples_are_judged_one_sample_ahead(ahead, end):
    made = findings(ahead=ahead)
    said = text(unseen_sentences(made))
    assert f"for noise moves the plant. Foretold one sample ahead it is 0.{round(50 * ahead):03d}"[:70] in said
    assert said.endswith(end)
    assert failing(made) == (["y"] if ahead > 2 else [])
    plain = {**made, "filtered": None}
    assert "one sample ahead" not in text(unseen_sentences(plain))
    assert failing(plain) == ["y"]  # three times in a simulation


def test_a_simulation_that_cannot_know_what_moved_the_plant_is_not_called_bad():
    assert [s["level"] for s in fit_sentences(findings())] == ["info"]
    assert [s["level"] for s in fit_sentences({**findings(), "filtered": None})] == ["bad"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({}, True),
        ({"estimator": "least squares"}, False),  # who asks for it knows
        ({"filterable": False}, False),  # dry friction: there is no such estimate
    ],
)
def test_the_estimator_is_named_where_it_may_help(change, told):
    errors = {"kind": "robust", "in_time": True, "filterable": True, "estimator": None, **change}
    made = {**findings(), "filtered": None, "correlated": None, "standard_errors": errors}
    assert (HINT in text(weighted_sentences(made, ["y"]))) == told
    assert HINT not in text(weighted_sentences(made, []))  # white residuals
    named = {**made, "diagnosis": {"rounds": [{"found": ["drift of y"], "likely": "possibly"}]}}
    assert HINT not in text(weighted_sentences(named, ["y"]))
    assert HINT not in text(weighted_sentences({**made, "diagnosis": None}, ["y"]))  # nothing was tried


@pytest.mark.parametrize("seed", range(5))
def test_errors_ahead_that_follow_an_input_refuse_a_filter(seed):
    rng = np.random.default_rng(seed)
    u, noise = rng.normal(size=400), rng.normal(size=400)
    model = pf.equations("x' = (u - x)/a\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters={"a": {}})
    record = pf.from_arrays(period=1.0, signals={"u": u, "y": noise}, name="run")
    problem = pf.Problem(model, record, {"a": (0.1, 9.0)}, estimator="ekf")

    def why(error):
        ahead = {"run": {"y": noise - error}}
        return pattern_ahead(problem, Filtered(np.zeros(1), np.ones(1), np.ones((1, 1)), {}, ahead, {}))

    assert why(rng.normal(size=400)) is None
    follows = why(rng.normal(size=400) + np.r_[0.0, 0.6 * u[:-1]])
    assert follows is not None
    assert follows.startswith("one sample ahead the errors of y are correlated with u, so that noise")
    coloured = why(np.convolve(rng.normal(size=400), [1.0, 0.7], "same"))
    assert coloured is not None
    assert coloured.startswith("one sample ahead the errors of y are not white (p = ")
