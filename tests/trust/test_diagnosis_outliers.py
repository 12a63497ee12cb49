"""What is said of outliers and of a diagnosis that was stopped: the step takes what it says."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

from plantfit import fit
from plantfit.recording.clean import outliers
from plantfit.spec import load
from plantfit.trust.diagnosis import Meter, clean_steps, diagnose, diagnosis_record


@pytest.fixture(scope="module")
def spiky(tmp_path_factory):
    """A plant of second order with a dead time and fifteen outliers, half of them on slopes, and its diagnosis."""
    problem = load(write(PLANTS["second"], "dead_time+outliers", 0.01, 5, tmp_path_factory.mktemp("spiky"))).problem
    answer = fit(problem, budget=1500)
    return answer, diagnose(answer.problem, answer.best.x, rounds=1)


def test_the_step_takes_all_by_their_times(spiky):
    _, d = spiky
    (step,) = clean_steps(d)["a"]
    assert step["step"] == "drop_samples"
    assert len(step["times"]) == d.apart.sum()
    assert "drop_samples under clean takes them away." in diagnosis_record(d)["verdict"][0]["sentence"]


def test_of_too_many_the_sentence_says_how_many_are_taken(spiky, monkeypatch):
    _, d = spiky
    monkeypatch.setattr(outliers, "_MOST_TIMES", 3)
    (step,) = clean_steps(d)["a"]
    assert step["step"] == "drop_outliers"
    said = diagnosis_record(d)["verdict"][0]["sentence"]
    taken = int(said.split("under clean takes ")[1].split(" of them away")[0])
    assert 0 < taken < d.apart.sum()


@pytest.mark.parametrize(
    ("turn", "said"), [(1, "additions to the model were tried until then"), (2, "were tried alone")]
)
def test_a_diagnosis_that_is_stopped_says_how_far_it_came(spiky, turn, said):
    """In its first round, and in the second beside what that found."""
    answer, whole = spiky
    told = []
    meter = Meter(stop=lambda: told.count("trying saturation of u") >= turn, winds_up=True)
    sentences = [
        v["sentence"]
        for v in diagnosis_record(diagnose(answer.problem, answer.best.x, told.append, meter=meter))["verdict"]
    ]
    assert meter.stopped
    assert any(s.startswith("It was stopped: ") and said in s for s in sentences)
    assert not any(v["sentence"].startswith("It was stopped") for v in diagnosis_record(whole)["verdict"])
