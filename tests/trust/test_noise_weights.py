"""Generalised least squares as the answer: where noise is correlated or shared it is, where a model is wrong it is
not, and all that an answer tells is of one estimate."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "estimate"))
from correlated_plants import autoregression, encoder, oven

import plantfit as pf
from plantfit.errors import SpaceError, SpecError
from plantfit.problem.correlated.weighted_answer import Weighted
from plantfit.spec.reading import load
from plantfit.trust.finish.noise_weights import weights_at
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.plausible import plausible
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import type_b
from plantfit.trust.verdict.estimators.correlated import weighted_sentences

GLS, PLAIN = "generalised least squares", "least squares"
TRUTH = {"K": 1.7, "tau": 30.0, "c": 22.0}


def said(answer):
    return [s["sentence"] for s in answer.findings["verdict"]]


def intervals(answer):
    return {r["name"]: (r["low"], r["high"]) for r in answer.findings["parameters"]}


@pytest.mark.parametrize("count", [6, pytest.param(16, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_with_correlated_noise_values_and_intervals_are_those_of_generalised_least_squares(count):
    held, shorter, nearer, taken = [], [], [], 0
    for seed in range(count):
        answer = pf.fit(oven(seed, estimator=GLS), runs=1, seed=seed)
        plain = answer.by_least_squares
        found = weights_at(answer.problem.with_answer(None), answer.best.x)
        if not isinstance(found, Weighted):  # by chance, as Hausman's test of a right model at 1 %
            assert answer.values == plain.values
            continue
        taken += 1
        assert list(answer.values.values()) == found.values.tolist()
        own, least = intervals(answer), intervals(plain)
        assert own == dict(found.interval)
        held += [own[n][0] <= v <= own[n][1] for n, v in TRUTH.items()]
        shorter.append([(own[n][1] - own[n][0]) / (least[n][1] - least[n][0]) for n in TRUTH])
        off = [[abs(a.values[n] - v) for n, v in TRUTH.items()] for a in (answer, plain)]
        nearer.append(off)
    assert taken >= 0.8 * count
    assert np.mean(held) >= 0.88  # 95 % of 48 are 46
    assert np.median(shorter) < 1.0
    own, least = np.sqrt(np.mean(np.square(nearer), axis=0))
    assert np.mean(own / least) < 1.0


@pytest.mark.parametrize("seeds", [(2, 3), pytest.param(range(5), marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_errors_that_samples_share_are_weighed_without_asking(seeds):
    held, ratios = [], []
    for seed in seeds:
        answer = pf.fit(encoder(seed), runs=1)
        least = pf.fit(encoder(seed, estimator=PLAIN), runs=1)
        assert answer.problem.weighted is not None
        assert least.problem.weighted is None
        assert answer.by_least_squares.values == least.values
        own = intervals(answer)
        held += [own[n][0] <= v <= own[n][1] for n, v in {"K": 5.0, "tau": 0.4}.items()]
        ratios.append(np.array(list(answer.standard_errors.values())) / list(least.standard_errors.values()))
        [text] = [s for s in said(answer) if "estimated together" in s]
        assert text.startswith(
            "The parameters were estimated together with the noise of speed (generalised least squares): intervals are"
        )
        assert text.endswith(" times as long as by least squares.")
        assert not [s for s in said(least) if "estimated together" in s]
    assert sum(held) >= 0.75 * len(held)
    assert np.all(np.median(ratios, axis=0) < 0.5)


def test_all_that_an_answer_tells_is_of_one_estimate(tmp_path):
    answer = pf.fit(oven(1, estimator=GLS), runs=1, store=tmp_path / "store.db")
    weighted = answer.problem.weighted
    assert weighted is not None
    rows = {r["name"]: r for r in answer.findings["parameters"]}
    assert {n: r["value"] for n, r in rows.items()} == answer.values
    assert all(r["low"] < r["value"] < r["high"] and r["status"] == "determined" for r in rows.values())
    np.testing.assert_allclose(np.sqrt(np.diag(weighted.covariance)), list(answer.standard_errors.values()), rtol=1e-9)
    np.testing.assert_allclose(np.asarray(answer.covariance), weighted.covariance, rtol=1e-6)
    expected = answer.problem.predict(np.array(list(answer.values.values())), "run 1")["y"]
    np.testing.assert_array_equal(answer.simulated["run 1"]["y"], expected)
    np.testing.assert_allclose(answer.findings["recordings"][0]["outputs"]["y"]["simulated"], expected)
    drawn = plausible(answer.problem, answer.z, answer.findings["parameters"], 4000).values[1:]
    np.testing.assert_allclose(np.cov(drawn.T), weighted.covariance, rtol=0.2)
    np.testing.assert_allclose(np.mean(drawn, axis=0), list(answer.values.values()), rtol=1e-2)
    band = answer.bands("run 1", draws=400)["y"]
    assert np.all((band.low[1:] < expected[1:]) & (expected[1:] < band.high[1:]))
    middle, half = 0.5 * (band.low + band.high)[1:], 0.5 * (band.high - band.low)[1:]
    assert np.all(np.abs(middle - expected[1:]) < 0.35 * half)
    again = pickle.loads(pickle.dumps(answer))
    assert (again.values, again.findings) == (answer.values, answer.findings)
    opened = pf.open_study(1, tmp_path / "store.db", problem=oven(1, estimator=GLS))
    assert opened.values == answer.values
    assert intervals(opened) == intervals(answer)


@pytest.mark.parametrize("count", [3, pytest.param(6, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_model_that_lacks_something_keeps_least_squares_and_says_why(count):
    kept = 0
    for seed in range(count):
        wrong = {"correlation": 0.5, "second": 5.0, "n": 400}
        answer = pf.fit(oven(seed, **wrong, estimator=GLS), runs=1, seed=seed)
        if answer.problem.weighted is None:
            kept += 1
            assert answer.values == pf.fit(oven(seed, **wrong, estimator=PLAIN), runs=1, seed=seed).values
            [text] = [s for s in said(answer) if "was asked for" in s]
            assert text.startswith("Generalised least squares was asked for and is not the answer: ")
            assert answer.problem.not_weighted
    assert kept >= count - 1


@pytest.mark.thorough
def test_where_it_cannot_be_the_reason_is_named():
    def reason(problem, **options):
        answer = pf.fit(problem, runs=1, **options)
        assert answer.problem.weighted is None
        told = [s for s in said(answer) if "was asked for" in s]
        assert told == [
            f"Generalised least squares was asked for and is not the answer: {answer.problem.not_weighted}."
        ]
        return answer.problem.not_weighted

    assert reason(oven(0, correlation=0.0, estimator=GLS)) == "the residuals are white, so that it is least squares"
    assert reason(oven(2, extra=" + d", estimator=GLS)) in ("c is not determined", "d is not determined")
    stated = [SharedError(type_b("offset of y", 0.5), "offset", "y")]
    assert reason(oven(1, estimator=GLS), errors=stated) == "errors of instruments are stated"
    assert reason(oven(3, correlation=0.98, estimator=GLS)).endswith(
        " independent ones, too few to tell noise from what the model lacks"
    )
    rng = np.random.default_rng(3)
    tables = {"f": {"over": "x", "nodes": [0, 1, 2]}}
    model = pf.equations("y = f(x)", inputs=["x"], outputs=["y"], tables=tables)
    x = np.linspace(0.0, 2.0, 200)
    signals = {"x": pf.Signal(x), "y": pf.Signal(x + 0.1 * autoregression(200, [0.8], rng))}
    curve = pf.Problem(model, pf.Recording(0.1 * np.arange(200.0), signals, "rows"), {"f": (-9, 9)}, estimator=GLS)
    assert reason(curve) == "tables and more than 60 parameters have least squares alone"
    model = pf.equations("y = a*x + b", inputs=["x"], outputs=["y"], parameters=["a", "b"])
    x = np.linspace(0.0, 4.0, 200)
    signals = {"x": pf.Signal(x), "y": pf.Signal(2 * x + 1 + 0.1 * autoregression(200, [0.8], rng))}
    bounds = {"a": (-10, 10), "b": (-10, 10)}
    line = pf.Problem(model, pf.Recording(np.arange(200.0), signals, "rows"), bounds, estimator=GLS)
    answer = pf.fit(line, runs=1)
    assert answer.problem.not_weighted.startswith("rows without times")
    timed = pf.Problem(model, pf.Recording(0.1 * np.arange(200.0), signals, "rows"), bounds, estimator=GLS)
    assert pf.fit(timed, runs=1).problem.weighted is not None


@pytest.mark.thorough
def test_recordings_that_agree_are_weighed_together_and_those_that_do_not_are_told():
    answer = pf.fit(oven(5, recordings=3, n=400, estimator=GLS), runs=1)
    assert answer.problem.weighted is not None
    own = intervals(answer)
    for n, v in TRUTH.items():
        assert own[n][0] - 0.5 * (own[n][1] - own[n][0]) < v < own[n][1] + 0.5 * (own[n][1] - own[n][0])
    assert answer.findings["heterogeneity"]["agree"]
    assert pf.compare_records(answer).typed.agree  # each alone by least squares, as all together there
    assert not [s for s in said(answer) if "too short" in s]


@pytest.mark.thorough
def test_intervals_and_estimates_of_every_kind_begin_at_least_squares():
    answer = pf.fit(oven(6, estimator=GLS), runs=1)
    least = answer.by_least_squares
    compared = pf.compare_intervals(answer, kinds=["covariance", "profile"])
    for row in compared.typed.parameters:
        assert row.value == pytest.approx(least.values[row.name], rel=1e-6)
    found = pf.estimate_parameters(answer, methods=[GLS])
    for p in found.typed.parameters:
        assert p.estimates[PLAIN].value == least.values[p.name]
        assert p.estimates[GLS].value == pytest.approx(answer.values[p.name], rel=1e-9)
    found = answer.diagnose()
    assert found is None or not any(r["found"] for r in found["rounds"])


def test_a_warning_stands_beside_intervals_that_take_a_fault_for_noise():
    row = {"unit": "V", "low": 1.9, "high": 2.1, "value": 2.0}
    wide = {**row, "low": 1.8, "high": 2.2}
    findings = {
        "correlated": {
            "noise": [{"output": "y", "order": 1, "form": None}],
            "parameters": [{"name": "a", **row}, {"name": "b", **row}],
            "least_squares": [{"name": "a", **wide}, {"name": "b", **row}],
        },
        "parameters": [],
        "diagnosis": None,
        "heterogeneity": {"agree": True},
    }
    [text] = weighted_sentences(findings, ["y"])
    assert text["sentence"] == (
        "The parameters were estimated together with the noise of y (generalised least squares): intervals are 0.5 (a) "
        "to 1 (b) times as long as by least squares."
    )
    [_, warned] = weighted_sentences({**findings, "heterogeneity": {"agree": False}}, ["y"])
    assert warned["level"] == "warning"
    assert warned["sentence"] == (
        "These intervals take what is left of y for noise, and it is not noise alone: they may be too short; "
        '`estimator = "least squares"` gives those that allow for it.'
    )


def test_the_key_of_the_study_file(tmp_path: Path):
    text = '''name = "oven"
{line}
[recording.run]
file = "oven.csv"
[model]
equations = """
x' = (K*u - x)/tau
y = x + c
"""
inputs = {{ u = "1" }}
states = {{ x = {{ unit = "1", initial = 0 }} }}
outputs = {{ y = "1" }}
[parameters]
K = {{ bounds = [0.1, 10] }}
tau = {{ bounds = [1, 300], unit = "s" }}
c = {{ bounds = [0, 50] }}
'''
    record = oven(1, estimator=GLS).experiments["run 1"].recording
    rows = "\n".join(f"{t:g},{u:g},{y:.9g}" for t, u, y in zip(record.t, record["u"], record["y"], strict=True))
    (tmp_path / "oven.csv").write_text(f"t,u,y\n{rows}\n", "utf-8")
    study = tmp_path / "oven.toml"
    for line, expected in (("", False), (f'estimator = "{GLS}"', True), (f'estimator = "{PLAIN}"', False)):
        study.write_text(text.format(line=line), "utf-8")
        assert load(study).problem.generalised == expected
    study.write_text(text.format(line='estimator = "gls"'), "utf-8")
    with pytest.raises(SpecError, match="estimator"):
        load(study)
    with pytest.raises(SpaceError, match=r"give 'least squares', 'generalised least squares', .* or 'ukf'"):
        oven(0, estimator="gls")


def test_the_linearised_problem_is_the_weighted_one_at_its_answer_alone():
    answer = pf.fit(oven(7, estimator=GLS), runs=1)
    weighted = answer.problem.weighted
    assert weighted is not None
    here = linearise(answer.problem, answer.z)
    there = linearise(answer.problem, answer.best.x)
    np.testing.assert_array_equal(here.covariance, weighted.covariance)
    assert not np.allclose(there.covariance, weighted.covariance, rtol=0.05)
    changed = answer.problem.with_starts({})
    assert changed.weighted is None
    assert here.linear is not None
    form = here.linear.rows.T @ here.linear.rows
    np.testing.assert_allclose(form @ here.linear.spread, np.eye(3), atol=1e-8)
