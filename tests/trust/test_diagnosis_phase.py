"""The diagnosis of an answer that was judged: when it is made, how much it may cost, and a verdict that does not
contradict it."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, write

import plantfit as pf
from plantfit.errors import ModelError
from plantfit.findings import Cross
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.problem.measure.experiment import Experiment
from plantfit.recording.record import Recording, Signal
from plantfit.report import render_html
from plantfit.report.sections.sentences import independence
from plantfit.spec import load
from plantfit.trust.diagnosis import Meter, Stopped, asked_for, diagnose, phase, rounds
from plantfit.trust.diagnosis.sentences import _untried
from plantfit.trust.verdict.residuals import noise_sentences, residual_sentences
from plantfit.trust.verdict.unseen import unseen_sentences


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """The answer of a first-order plant whose model lacks a dead time."""
    return fit(load(write(PLANTS["first"], "dead_time", 0.02, 5, tmp_path_factory.mktemp("late"))).problem, budget=600)


def test_what_limits_the_work_is_told_and_nothing_is_called_sure(late, monkeypatch):
    before = late.findings
    monkeypatch.setattr(phase, "FLOOR_SAMPLES", 0.0)
    monkeypatch.setattr(phase, "TIMES", 120.0 / sum(r.evaluations for r in late.runs))
    cut = phase.with_diagnosis(late.problem, late.runs, before)
    d = cut["diagnosis"]
    assert d["state"] == "part"
    first = d["rounds"][0]
    assert first["tried"]
    assert first["untried"]
    assert {"offset of y", "drift of y"} <= {t["name"] for t in first["tried"]}  # the least work first
    said = [v["sentence"] for v in d["verdict"]]
    assert any("additions to the model were tried within" in s and "tries the rest" in s for s in said)
    assert not any("likely missing" in s for s in said)
    assert d["rounds"] == phase.with_diagnosis(late.problem, late.runs, before)["diagnosis"]["rounds"]


def test_first_tries_are_shortened_where_else_the_last_additions_would_have_none(late, monkeypatch):
    monkeypatch.setattr(phase, "FLOOR_SAMPLES", 0.0)
    monkeypatch.setattr(phase, "TIMES", 700.0 / sum(r.evaluations for r in late.runs))

    def first():
        return phase.with_diagnosis(late.problem, late.runs, late.findings)["diagnosis"]["rounds"][0]

    shortened = first()
    assert shortened["untried"] == []
    assert shortened["found"] == ["dead time of u"]
    monkeypatch.setattr(rounds, "_steps_for", lambda *_: rounds.QUICK)
    assert "sensor lag of y" in first()["untried"]


def test_the_diagnosis_of_an_answer_stands_in_findings_verdict_and_report(late):
    values, sentence = dict(late.values), "look for disturbances"
    assert late.findings["diagnosis"] is None
    stopped = late.diagnose(stop=lambda: True)
    assert stopped is not None
    assert stopped["state"] == "stopped"
    assert "answer.diagnose(whole=True)" in late.verdict
    told = []
    found = late.diagnose(progress=told.append)
    assert found is not None
    assert found["state"] == "whole"
    assert any("dead time of u" in t for t in told)
    assert found["evaluations"] <= found["allowed"] * 1.2
    assert "dead time of" in late.verdict
    assert sentence not in late.verdict
    assert not list(noise_sentences(late.findings))  # the jumps that the dead time leaves pass for noise
    assert late.values == values
    (series,) = found["residuals"]
    both = [[v**2 for v in series[k] if v is not None] for k in ("before", "after")]
    assert sum(both[1]) < 0.1 * sum(both[0])
    assert len(series["t"]) == len(series["before"]) == len(series["after"])
    assert "What may be missing" in render_html(late.findings)


def test_nothing_is_looked_for_where_the_residual_is_noise_or_the_model_has_no_time(late):
    white: dict[str, Any] = {
        **late.findings,
        "residual_tests": [{**t, "white": True} for t in late.findings["residual_tests"]],
    }
    quiet = [
        {**r, "outputs": {n: {**o, "simulated": o["measured"]} for n, o in r["outputs"].items()}}
        for r in white["recordings"]
    ]
    assert asked_for(late.findings)
    assert asked_for(white)  # not at the noise
    assert not asked_for({**white, "recordings": quiet})
    k = np.arange(40.0)
    steady = Recording(k, {"u": Signal(0.1 * k), "y": Signal(0.01 * k**2)}, "a")
    model = equations("y = a*u", inputs=["u"], outputs=["y"], parameters={"a": {"bounds": (0, 20)}})
    answer = fit(Problem(model, steady), budget=200)
    assert asked_for(answer.findings)
    told = answer.diagnose()
    assert told is not None
    assert told["rounds"][0]["tried"][0]["name"] in ("change of a with u", "part of y by the square of u")
    x = equations("x' = a*u - x", states=["x"], inputs=["u"], outputs=["x"], parameters={"a": {"bounds": (0, 20)}})
    record = Recording(k, {"u": Signal(0.1 * k), "x": Signal(0.01 * k**2)}, "a")
    mixed = fit(Problem(x, {"a": Experiment(record), "b": Experiment(record, steady=True)}), budget=200)
    assert mixed.diagnose() is None
    with pytest.raises(ModelError, match="all over time or all at rest"):
        mixed.diagnose(whole=True)


def test_no_other_sentence_guesses_at_causes_once_one_is_named():
    row = {
        "recording": "a",
        "output": "y",
        "white": False,
        "autocorrelation": [1.0, 0.9],
        "lags_s": [0, 1],
        "bound": 0.1,
        "p_value": 0.0,
    }
    unseen = {
        "recording": "a",
        "output": "y",
        "unit": "V",
        "part": "validation",
        "n": 50,
        "rmse": 2.0,
        "bias": 1.9,
        "fit_percent": 10.0,
    }

    def said(independent, found):
        rounds = None if found is None else {"rounds": [{"found": ["dead time of u"] if found else []}]}
        tests = [
            {
                **row,
                "cross": {
                    "u": {"lags_s": [], "values": [], "bound": 0.1, "independent": independent, "explained": -0.1}
                },
            }
        ]
        findings = {
            "recordings": [{"name": "a"}],
            "residual_tests": tests,
            "scores": [{**unseen, "part": "fit", "rmse": 1.0}, unseen],
            "diagnosis": rounds,
        }
        return [next(iter(made(findings)))["sentence"] for made in (residual_sentences, unseen_sentences)]

    assert "look for disturbances" in said(True, None)[0]
    assert "incomplete" in said(False, None)[0]
    assert "offset that changed" in said(True, None)[1]
    assert said(True, True)[0].endswith("something systematic is missing.")
    assert said(False, True)[0].endswith("something systematic is missing.")
    assert "constant shift of 1.9 V is part of it;" in said(True, True)[1]
    assert said(True, False)[0].endswith("something systematic is missing.")  # drift and sensors were tried
    assert "incomplete" in said(False, False)[0]
    assert "Independent" not in independence("u", Cross(lags_s=[], values=[], bound=0.1, independent=True), named=True)


def test_a_meter_counts_and_stops(late):
    meter = Meter(limit=10.0)
    meter.charge(4.0)
    assert meter.holds(6.0)
    assert not meter.holds(6.1)
    assert meter.holds(3.0, 0.5, since=4.0)
    assert not meter.holds(3.1, 0.5, since=4.0)
    with pytest.raises(Stopped):
        diagnose(late.problem, late.best.x, meter=Meter(stop=lambda: True))


def test_several_additions_are_tried_each_beside_those_before(late):
    d = diagnose(late.problem, late.best.x, only=["dead time of u", "drift of y"])
    assert [[t.extension.name for t in r.trials] for r in d.rounds] == [["dead time of u"], ["drift of y"]]
    assert d.rounds[1].given == (d.rounds[0].trials[0].extension,)


def test_findings_tell_what_is_odd_about_the_data(tmp_path):
    answer = pf.fit(load(write(PLANTS["first"], "sensor_high", 0.02, 5, tmp_path)).problem, budget=300)
    (look,) = [one for one in answer.findings["data"] if one["kind"] == "clipped"]
    assert look["recording"] == "a"
    assert look["begin"] < look["end"]
    page = render_html(answer.findings)
    assert "Looks at the data" in page
    assert look["sentence"][:30] in page


def lagging(u, gain, tau, period):
    """A first-order plant at rest at first, driven by u (n,) held between samples."""
    x = np.empty(len(u))
    x[0] = gain * u[0]
    for k in range(len(u) - 1):
        x[k + 1] = gain * u[k] + (x[k] - gain * u[k]) * np.exp(-period / tau)
    return x


def diagnosed_as_a_lag(t, u, y, slowest):
    """(answer, diagnosis) of a first-order model that begins at the first measured value."""
    bounds = {"b": {"bounds": (0.01, 10.0)}, "T": {"bounds": (slowest / 500.0, slowest)}}
    model = equations(
        "x' = (b*u - x)/T; y = x", inputs=["u"], states={"x": {"initial": "y"}}, outputs=["y"], parameters=bounds
    )
    found = fit(Problem(model, Recording(t, {"u": Signal(u), "y": Signal(y)})), budget=400, seed=1)
    found.findings["reproduction"]["command"] = "plantfit run tank.toml"
    return found, found.diagnose()


@pytest.mark.parametrize("stuck", [0, 60, 90])
@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.slow) for s in (0, 2))])
@pytest.mark.further(1)
def test_beside_a_sensor_that_was_stuck_no_addition_is_proposed(seed, stuck):
    """The truth is a first-order plant; nothing is missing but the samples of the sensor."""
    rng, n = np.random.default_rng(seed), 900
    t, u = 0.5 * np.arange(n), np.repeat(rng.uniform(1.0, 6.0, 15), 60)
    y = lagging(u, 0.8, 40.0, 0.5) + 0.01 * rng.normal(size=n)
    y[400 : 400 + stuck] = y[400]
    found, d = diagnosed_as_a_lag(t, u, y, 500.0)
    said = [v["sentence"] for v in found.findings["verdict"] if "may have been stuck" in v["sentence"]]
    if stuck:
        assert d is not None
        assert d["next"] == ""
        what = d.get("wandering") or d.get("drifting") or any(r["found"] for r in d["rounds"])
        assert len(said) == bool(what)
    else:
        assert said == []


@pytest.mark.parametrize("every", [1, 8])
@pytest.mark.thorough
def test_beside_an_output_that_is_read_seldom_no_addition_is_proposed(every):
    """The repeats look like a lag of the input, "very likely missing", and nothing is missing but fresh samples."""
    told = 0
    for seed in range(2):
        rng, n = np.random.default_rng(seed), 800
        t, u = 0.1 * np.arange(n), np.repeat(rng.uniform(0.0, 5.0, 32), 25)
        y = np.repeat((lagging(u, 2.0, 1.5, 0.1) + 0.01 * rng.normal(size=n))[::every], every)
        found, d = diagnosed_as_a_lag(t, u, y, 50.0)
        said = [
            v["sentence"]
            for v in found.findings["verdict"]
            if "was read more seldom than it was recorded" in v["sentence"]
        ]
        if every == 1:
            assert said == []
            assert d is None or not any(r["found"] for r in d["rounds"])
            continue
        assert d is not None
        assert len(said) == any(r["found"] for r in d["rounds"])
        if said:
            told += 1
            assert d["next"] == ""
            assert said[0].endswith("keep the fresh samples alone, as the look at y says, and run again.")
    assert told == (0 if every == 1 else 2)


@pytest.mark.parametrize(
    ("seed", "slowest"),
    [(1, 12.0), (0, 500.0), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((0, 12.0), (1, 500.0)))],
)
@pytest.mark.thorough
def test_beside_a_parameter_that_is_pressed_on_its_bound_no_addition_is_proposed(seed, slowest):
    """The truth has T = 40 s, and a dead time of 3 s that nothing of the model stands for."""
    rng, n = np.random.default_rng(seed), 900
    t, u = 0.5 * np.arange(n), np.repeat(rng.uniform(1.0, 6.0, 15), 60)
    y = lagging(np.r_[np.full(6, u[0]), u[:-6]], 0.8, 40.0, 0.5) + 0.01 * rng.normal(size=n)
    found, d = diagnosed_as_a_lag(t, u, y, slowest)
    assert d is not None
    assert any(r["found"] for r in d["rounds"])
    said = [v["sentence"] for v in found.findings["verdict"] if "a bound of the search" in v["sentence"]]
    if slowest < 40.0:
        assert d["next"] == ""
        assert said[0].startswith("T ended on a bound of the search, and what is said of what may be missing may stand")
        assert "else run `plantfit run tank.toml --try " in said[0]
    else:
        assert said == []
        assert "--try" in d["next"]


@pytest.mark.parametrize(
    ("untried", "second", "said"),
    [
        ("abc", None, "one of the 3 additions that were not tried"),
        ("a", None, "the one addition that was not tried"),
        ("ab", "cd", "one of the 2 additions that were not tried beside what was found before"),  # alone they were
        ("", "d", "the one addition that was not tried beside what was found before"),
        ("ab", "ab", "one of the 2 additions that were not tried"),  # neither alone nor beside it
        ("b", "bcd", "the one addition that was not tried"),
    ],
)
def test_additions_that_were_tried_alone_are_not_called_untried(untried, second, said):
    tried = [SimpleNamespace(extension=e) for e in "abcdef" if e not in untried]
    rounds = [SimpleNamespace(trials=tried, untried=tuple(untried))]
    if second is not None:
        rounds.append(SimpleNamespace(trials=tried[-1:], untried=tuple(second)))
    whole: Any = SimpleNamespace(rounds=rounds)
    last: Any = rounds[-1]
    assert _untried(whole, last) == said


@pytest.mark.parametrize(
    ("whole", "untried", "found", "said"),
    [
        (True, 0, 0, ""),
        (
            False,
            2,
            0,
            "2 of 4 additions to the model were tried within the 300 evaluations that it may take; do tries the",
        ),
        (False, 0, 1, "What may be missing beside that was not tried in full within the 300 evaluations"),
        (False, 0, 0, "What may be missing was not tried in full within the 300 evaluations"),
    ],
)
def test_what_the_work_did_not_suffice_for_is_told(whole, untried, found, said):
    """A pattern or a step that was not fitted leaves no addition untried, and may be all that is missing."""
    first = SimpleNamespace(trials=[None] * 2, untried=[None] * untried)
    made = SimpleNamespace(
        whole=whole, rounds=[first], found=[None] * found, carrier=SimpleNamespace(meter=SimpleNamespace(limit=300.0))
    )
    told = [s["sentence"] for s in phase._cut(made, "do")]  # pyrefly: ignore[bad-argument-type]
    assert [t.startswith(said) for t in told] == ([True] if said else [])


@pytest.mark.parametrize("agree", [True, False, None])
@pytest.mark.parametrize("sure", ["very likely", "likely", "possibly", None])
def test_where_recordings_disagree_and_nothing_is_likely_each_is_fitted_alone_next(monkeypatch, sure, agree):
    change = SimpleNamespace(name="change of ua with t")
    monkeypatch.setattr(phase, "changed", lambda found: [change])
    monkeypatch.setattr(phase, "likelihood", lambda found, one: sure)
    findings = {"heterogeneity": {"agree": agree}, "reproduction": {"command": "plantfit run my batch.toml"}}
    found: Any = SimpleNamespace(rounds=[None])
    told = phase._next(found, findings)
    if agree is False and sure in ("possibly", None):
        assert told == "plantfit compare-records 'my batch.toml'"
    else:
        assert told == "plantfit run 'my batch.toml' --try \"change of ua with t\""
    assert phase._next(found, {**findings, "reproduction": {"command": ""}}) == ""
