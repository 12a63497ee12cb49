"""What the verdict of a study says before a controller that is tuned on its model: where that is wrong, and only
there."""

import copy

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust.validate.doubts import doubts

T = 0.05 * np.arange(800)
U = np.repeat(np.random.default_rng(3).uniform(-2.0, 2.0, 40), 20)
TAU, K, NOISE = 0.4, 3.0, 0.02


def simulated(change, seed):
    """A lag driven by `change(u)`, by exact steps, with noise."""
    x, y = 0.0, []
    a = np.exp(-0.05 / TAU)
    for u in U:
        y.append(x)
        x = a * x + (1.0 - a) * K * change(u)
    return np.array(y) + NOISE * np.random.default_rng(seed).standard_normal(len(T))


def answered(change, seed=5):
    model = pf.equations(
        "x' = (K*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["K", "tau"], name="lag"
    )
    record = pf.from_arrays(T, signals={"u": U, "y": simulated(change, seed)})
    space = {"K": pf.Parameter((0.1, 20)), "tau": pf.Parameter((0.02, 5))}
    return pf.fit(pf.Problem(model, {"a": pf.Experiment(record, fit=(0, 25), validate=(25, 40))}, space), budget=200)


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_of_a_model_that_holds_nothing_is_said(seed):
    assert not list(doubts(answered(lambda u: u, seed).findings))


@pytest.mark.parametrize("change", [lambda u: np.sign(u) * u**2, lambda u: np.clip(u, -0.5, 1.9), abs])
def test_a_model_that_lacks_something_is_told_and_stands_before_the_promise(change):
    (one,) = doubts(answered(change).findings)
    assert one["level"] in ("warning", "bad")
    assert "what is promised below may not hold on the plant" in one["sentence"]


def test_what_the_diagnosis_calls_missing_or_found_is_told():
    findings = copy.deepcopy(answered(lambda u: u).findings)
    rounds = [{"found": ["dead time of u", "further lag of u"], "likely": "very likely"}, {"found": []}]
    for made, words in (
        ({"rounds": rounds}, "The model lacks dead time of u, by its diagnosis: "),
        ({"rounds": [], "stepping": {"steps": [{"at": 12.5}]}}, "A step at t = 12.5 s is left, and the model that is "),
        ({"rounds": [], "repeating": {"period": 86400.0}}, "A pattern that repeats every 24 h is left, and the model "),
        ({"rounds": [{"found": ["offset of y"], "likely": "possibly"}]}, ""),
    ):
        said = [s["sentence"] for s in doubts({**findings, "diagnosis": made})]
        assert [s.startswith(words) for s in said] == ([True] if words else [])


@pytest.mark.thorough
def test_they_stand_first_in_the_verdict_and_in_the_c_file(tmp_path):
    answer = answered(lambda u: np.sign(u) * u**2)
    found = pf.tune(answer, budget=5, plants=100, lower=-2.0, upper=2.0, set_point=1.0, step=0.5)
    assert "what is promised below may not hold on the plant" in found.verdict[0]["sentence"]
    assert found.verdict[1]["sentence"].startswith("Of 100 plants that the data allow, ")
    head = found.to_c(tmp_path).header.read_text("utf-8")
    assert "what is promised below may not hold on the plant" in head
    assert "Of 100 plants" in head
