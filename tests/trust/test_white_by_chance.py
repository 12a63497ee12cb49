"""Of many recordings of a right plant some fail the test of white noise; that is said to be chance, and nothing else
is."""

import numpy as np
import pytest

from plantfit.trust.verdict.outputs import WHITE
from plantfit.trust.verdict.residuals import by_chance, lacking, residual_sentences


def findings(p_values):
    tests = [
        {
            "recording": f"run-{k}", "output": "y", "white": bool(p > WHITE), "p_value": float(p), "n": 200,
            "autocorrelation": [1.0, 0.1],
            "cross": {}, "past": None, "shared": None, "stretch": None, "turned": None, "first": None,
        }
        for k, p in enumerate(p_values)
    ]  # fmt: skip
    return {
        "residual_tests": tests,
        "scores": [],
        "recordings": [],
        "outputs": ["y"],
        "parameters": [],
        "simulation": {},
    }


def accused(p_values):
    said = [s["sentence"] for s in residual_sentences(findings(p_values))]
    return any("something systematic is missing" in s for s in said)


@pytest.mark.parametrize("count", [2, 5, 20, 60])
def test_right_plants_are_accused_in_one_study_of_fifty_at_most(count):
    rng = np.random.default_rng(count)
    assert sum(accused(rng.random(count)) for _ in range(1500)) <= 0.02 * 1500 + 3 * np.sqrt(0.02 * 1500)


@pytest.mark.parametrize(("count", "share"), [(5, 0.6), (20, 0.3), (60, 0.15)])
def test_what_many_recordings_lack_is_told(count, share):
    """Each of them fails the test with this probability, none of them by much."""
    rng = np.random.default_rng(count)
    told = [
        accused(np.where(rng.random(count) < share, 0.009 * rng.random(count) + 0.001, rng.random(count)))
        for _ in range(300)
    ]
    assert np.mean(told) >= 0.9


def test_one_recording_of_many_that_lacks_much_is_told():
    rng = np.random.default_rng(0)
    assert all(accused(np.r_[1e-6, 0.02 + 0.98 * rng.random(count - 1)]) for count in (2, 20, 200))


def test_the_sentence_names_the_recording_and_no_problem():
    [said] = residual_sentences(findings(np.r_[0.5 * np.ones(19), 0.004]))
    assert said["level"] == "good"
    assert (
        "white in 19 of 20 recordings, and as few as fail the test at 1 % (run-19) do so by chance" in said["sentence"]
    )
    [white] = residual_sentences(findings(0.5 * np.ones(20)))
    assert "in all 20 recordings: no dynamics" in white["sentence"]
    assert not by_chance([0.004], 1)
    assert not by_chance([0.009] * 4, 20)


@pytest.mark.parametrize(("p", "lacks"), [(0.004, []), (1e-6, ["y"])])
def test_what_fails_by_chance_puts_no_parameter_in_doubt(p, lacks, monkeypatch):
    rows = [{"recording": f"run-{k}", "output": "y", "ratio": 1.5} for k in range(20)]
    monkeypatch.setattr("plantfit.trust.verdict.residuals.noise_rows", lambda _: rows)
    assert lacking(findings(np.r_[0.5 * np.ones(19), p])) == lacks


def shifted(means, unit="V"):
    """White residuals of noise 0.5 V about these means, 400 samples in each recording."""
    found = findings([0.4] * len(means))
    return found | {
        "scores": [
            {
                "recording": f"run-{k}", "output": "y", "unit": unit, "part": "fit", "n": 400, "bias": -mean,
                "rmse": float(np.hypot(0.5, mean)), "fit_percent": 90.0,
            }
            for k, mean in enumerate(means)
        ]
    }  # fmt: skip


def test_white_residuals_about_a_mean_leave_a_constant_to_explain():
    """The noise says nothing of its mean: a sensor that is off by forty times its noise leaves white residuals."""
    [said] = residual_sentences(shifted([0.2]))
    assert said["level"] == "warning"
    assert said["sentence"] == (
        "The residuals of y are white (p = 0.4) about a mean of 0.2 V, 8 standard errors from zero: what is left to "
        "explain is a constant, an offset of the sensor or of an input."
    )
    [said] = residual_sentences(shifted([0.0, -0.2, 0.01, 0.0, 0.02]))
    assert said["level"] == "warning"
    assert "But in run-1 a constant is left; run-1 has a mean of -0.2 V, 8 standard errors" in said["sentence"]


@pytest.mark.parametrize("means", [[0.0], [0.09], [0.09, -0.1, 0.0, 0.01, 0.0]])
def test_no_constant_is_left_of_a_mean_that_is_small(means):
    """The mean of 400 samples of 0.5 V is known to 0.025 V."""
    [said] = residual_sentences(shifted(means))
    assert said["level"] == "good"
    assert "no dynamics are left to explain" in said["sentence"]
    assert "mean" not in said["sentence"]
    assert "constant" not in said["sentence"]
