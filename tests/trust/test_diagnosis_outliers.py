"""What is said of outliers and of a diagnosis that was stopped: the step takes what it says."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

import plantfit as pf
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


def _stepped(taken, seed=1, spikes=()):
    """A lag of 0.12 s under steps every 0.8 s, sampled every 0.02 s: y as it was at the times `taken` (n,)."""
    rng = np.random.default_rng(seed)
    levels, n = rng.choice([0.0, 1.0, 2.0, 3.0], 21), len(taken)
    y, k, x, now = np.empty(n), 0, 0.0, 0.0
    for i, at in enumerate(taken):
        while 0.8 * (k + 1) <= at:
            x = 2 * levels[k] + (x - 2 * levels[k]) * np.exp(-(0.8 * (k + 1) - now) / 0.12)
            k, now = k + 1, 0.8 * (k + 1)
        x, now = 2 * levels[k] + (x - 2 * levels[k]) * np.exp(-(at - now) / 0.12), at
        y[i] = x
    y += 0.004 * rng.standard_normal(n)
    y[list(spikes)] += 0.3
    u = levels[np.arange(n) // 40]
    model = pf.equations(
        "x' = (K*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], name="lag",
        parameters={"K": {"bounds": (0.1, 10)}, "tau": {"bounds": (0.02, 2)}},
    )  # fmt: skip
    answer = fit(pf.Problem(model, pf.from_arrays({"t": 0.02 * np.arange(n), "u": u, "y": y}, time="t")), budget=300)
    return [v["sentence"] for v in diagnosis_record(diagnose(answer.problem, answer.best.x, rounds=1))["verdict"]]


@pytest.mark.thorough
def test_samples_behind_steps_of_an_input_are_no_outliers_where_the_clock_shakes():
    rng = np.random.default_rng(3)
    t = 0.02 * np.arange(800)
    said = _stepped(t + np.abs(rng.normal(0, 0.004, 800)))
    assert any("right behind steps of inputs lie far from their neighbours" in s for s in said)
    assert not any("drop_samples" in s for s in said)
    said = _stepped(t)  # an even clock
    assert not any("far from their neighbours" in s for s in said)


def test_spikes_anywhere_stay_outliers():
    t = 0.02 * np.arange(800)
    said = _stepped(t, spikes=(55, 133, 210, 377, 491, 642, 755))
    assert any("7 of 800 samples of y lie far from their neighbours" in s for s in said)
    assert not any("right behind steps" in s for s in said)
