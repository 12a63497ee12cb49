"""What the verdict says of a record that is not followed and whose start the simulation forgets, and what it says no
more."""

import pytest

from plantfit.trust.verdict.parameters import parameter_sentences
from plantfit.trust.verdict.residuals import residual_sentences

FORGETS = {"forgets": [{"recording": "run", "growth": 1e6, "tenfold": 1.0}]}
ROW = {
    "name": "a",
    "value": 1.0,
    "unit": None,
    "standard_error": 0.01,
    "low": 0.98,
    "high": 1.02,
    "status": "determined",
}


@pytest.mark.parametrize("forgets", [False, True])
def test_values_of_a_lost_fit_are_not_called_those_of_the_plant(forgets):
    findings = {
        "parameters": [ROW],
        "scores": [],
        "recordings": [],
        "residual_tests": [],
        "simulation": FORGETS if forgets else {},
    }
    [said] = parameter_sentences(findings)
    assert ("does not follow run: these are its values, and the plant's may be others" in said["sentence"]) == forgets
    assert said["level"] == ("warning" if forgets else "good")


@pytest.mark.parametrize("forgets", [False, True])
def test_advice_where_residuals_are_slow(forgets):
    determined = {"sound": False, "samples": 4.0, "of": 1, "combinations": [], "count": 0}
    scores = [{"part": "fit", "n": 500, "rmse": 1.0, "recording": "run", "output": "y"}]
    findings = {"parameters": [{**ROW, "status": "weak"}], "scores": scores, "recordings": [], "residual_tests": []}
    findings |= {"determined": determined, "simulation": FORGETS if forgets else {}}
    said = " ".join(s["sentence"] for s in parameter_sentences(findings))
    assert ("Pieces with starts of their own may tell them." in said) == forgets
    assert ("first add what the model lacks" in said) == (not forgets)


def test_residuals_of_other_recordings_are_told_all_the_same():
    tests = [
        {
            "recording": r,
            "output": "y",
            "white": True,
            "p_value": 0.5,
            "n": 100,
            "correlation": 0.0,
            "cross": [],
            "past": None,
            "shared": None,
        }
        for r in ("run", "other")
    ]
    findings = {
        "residual_tests": tests,
        "recordings": [{"name": "run"}, {"name": "other"}],
        "simulation": FORGETS,
        "scores": [],
    }
    said = [s["sentence"] for s in residual_sentences(findings)]
    assert len(said) == 1
    assert "y of other" in said[0]
