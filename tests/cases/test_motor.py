"""The motor's bench, the coefficients that its speed shows, the paper's two errors, and the figures of the demo."""

import functools
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import ss2tf

import plantfit.runtime  # noqa: F401
from plantfit.cases.motor.bench import PERIOD, TRUTH, bench, rig
from plantfit.cases.motor.demo import run
from plantfit.cases.motor.methods import guarded, parts_at
from plantfit.cases.motor.methods_section import _pairs
from plantfit.cases.motor.speed_law import coefficients, fitted_laws
from plantfit.cases.motor.surrogate import percent, structure, surrogate_speeds, two_errors_record
from plantfit.cases.shared.files import unpack
from plantfit.recording import to_csv
from plantfit.recording.record import Recording
from plantfit.spec import load, parse


@functools.cache
def made():
    return bench(seed=5)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The paper's objective on the first 20 s, with the true speed in the surrogate's place."""
    folder = unpack("motor", tmp_path_factory.mktemp("motor"))
    record = two_errors_record(made().recording, made().run.exact["w"])
    short = Recording(
        record.t[:200], {n: type(s)(s.values[:200], s.unit) for n, s in record.signals.items()}, record.name
    )
    to_csv(short, folder / "two_errors.csv")
    return load(folder / "two_errors.toml")


def test_the_bench_records_the_motor_that_it_says():
    r, exact = made().recording, made().run.exact
    assert len(r) == 1500
    np.testing.assert_allclose(np.diff(r.t), PERIOD)
    assert np.max(np.abs(r["V"])) == pytest.approx(11.0, abs=0.5 * rig().volts_per_count)
    p = TRUTH
    top = (p["Kt"] * r["V"].max() - p["Rm"] * p["Tf"]) / (p["Rm"] * p["Cm"] + p["Kb"] * p["Kt"])
    assert exact["w"][224] == pytest.approx(top, rel=5e-3)  # 2.5 s after a step, time constant 0.44 s
    error = (r["w"] - exact["w"])[1:] / np.abs(exact["w"][1:])
    assert np.nanstd(error) == pytest.approx(np.sqrt(2) * rig().slot_error, rel=0.1)  # a period lies between two edges
    assert np.mean(np.isnan(r["w"])) < 0.05


def test_the_coefficients_are_those_of_the_transfer_function():
    p = TRUTH | {"Kt": 0.07}
    a = np.array([[-p["Rm"] / p["Lm"], -p["Kb"] / p["Lm"]], [p["Kt"] / p["Jm"], -p["Cm"] / p["Jm"]]])
    top, below = ss2tf(a, np.array([[1 / p["Lm"]], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    np.testing.assert_allclose(coefficients(p)[:3], (below / top[0, -1])[::-1], rtol=1e-12)


def test_both_errors_are_the_papers(study):
    p = {"Rm": 2.0, "Lm": 0.08, "Kb": 0.05, "Jm": 0.004, "Cm": 0.003, "Tf": 1e-3}
    [experiment] = study.problem.experiments.values()
    r = experiment.recording

    def rate(_, x, volts):
        i, w = x
        return [
            (volts - p["Rm"] * i - p["Kb"] * w) / p["Lm"],
            (p["Kb"] * i - p["Cm"] * w - p["Tf"] * np.tanh(w / 0.1)) / p["Jm"],
        ]

    x = [np.zeros(2)]
    for volts in r["V"][:-1]:
        x.append(solve_ivp(rate, (0, PERIOD), x[-1], args=(volts,), method="LSODA", rtol=1e-9, atol=1e-10).y[:, -1])
    i, w = np.array(x).T
    e1 = np.sqrt(np.mean((w - r["w_seen"]) ** 2))
    e2 = np.sqrt(np.mean((np.r_[r["V"][0], r["V"][:-1]] - p["Rm"] * i - p["Kb"] * r["w_seen"]) ** 2))
    assert parts_at(study.problem, p) == pytest.approx((e1, e2), rel=2e-3)


def test_figures_15_and_16_draw_both_signals_and_their_differences(study):
    """Speed of model and surrogate, voltage calculated and applied: each pair differs by its error."""
    from plantfit.cases.motor.methods import GA, errors_at
    from plantfit.cases.motor.methods_section import _late, _over_time

    problem, late = study.problem, dict(TRUTH) | {"Lm": 2 * TRUTH["Lm"]}
    results = {label: [SimpleNamespace(cost=1.0)] for label in GA}
    found = SimpleNamespace(problem=problem, results=results, best=lambda label: late)
    lines = {line["name"]: np.array(line["y"]) for line in _over_time(found)["data"]}  # pyrefly: ignore[bad-argument-type]
    label = next(iter(GA))
    _, e1, e2 = errors_at(problem, late)
    for made, seen, error in ((f"model, {label}", "surrogate", e1), (f"calculated, {label}", "applied", e2)):
        assert len(lines[made]) == len(lines[seen]) == 200
        np.testing.assert_allclose(lines[seen] - lines[made], error, atol=1e-2)
    assert f"{label}, best run, e1" in lines
    assert _late(found) > 3.0  # ms: twice the inductance delays by Lm/Rm  # pyrefly: ignore[bad-argument-type]


def test_kt_is_tied_or_free_by_one_line(study):
    assert study.problem.space.names == ("Rm", "Lm", "Kb", "Jm", "Cm", "Tf") or "Kt" not in study.problem.space.names
    text = study.text.replace('tied = "Kb"', "")
    assert "Kt" in parse(text, study.path).problem.space.names


def test_candidates_that_overflow_are_counted_and_the_search_goes_on(study):
    found = guarded(study)
    assert found.failures > 0
    assert np.isfinite(found.cost)
    assert found.evaluations > 1500


def test_the_record_gives_its_coefficients_within_their_errors():
    found = fitted_laws([made().recording])
    errors = np.sqrt(np.diag(found.covariance[0]))
    true = np.array(coefficients(TRUTH))
    assert np.all(np.abs(found.values[0] - true) < 3 * errors)
    assert errors[0] < 0.005 * true[0]
    assert errors[1] < 0.005 * true[1]
    assert errors[2] < 0.1 * true[2]


def test_the_surrogate_is_nearer_to_the_true_speed_than_the_record():
    [speed] = surrogate_speeds([made().recording], 2)
    exact = made().run.exact["w"]
    assert percent(speed, made().recording["w"]) > 98.0
    assert percent(speed, exact) > 99.5 > 98.6 > percent(made().recording["w"], exact)
    assert structure(3).model.parameters[4].name == "a3"


def test_wins_over_many_methods_are_one_sentence():
    def pair(better, worse, a12, p, differs=True):
        return SimpleNamespace(
            better=better, worse=worse, a12=a12, p_holm=p, differs=differs, pairs=6, runs=(50, 50), sentence=f"{worse}?"
        )

    ends = [
        SimpleNamespace(name=n, cost=SimpleNamespace(median=m))
        for n, m in (("ga", 3.0), ("auto", 1.0), ("de", 2.0), ("pso", 1.1))
    ]
    pairs = [
        pair("auto", "ga", 1.0, 1e-9),
        pair("auto", "de", 0.71, 0.002),
        pair("auto", "pso", 0.55, 0.4, False),
        pair("de", "ga", 0.9, 0.01),
    ]
    told = _pairs(SimpleNamespace(methods=ends, pairs=pairs))  # pyrefly: ignore[bad-argument-type]
    assert told == [
        "auto beats, with the share of pairs of runs that it wins (A12): ga 1.00, de 0.71; largest p 0.002 after Holm "
        "for 6 pairs of "
        "methods, 50 runs each.",
        "pso?",
    ]
    assert _pairs(SimpleNamespace(methods=ends, pairs=pairs[2:])) == ["pso?"]  # pyrefly: ignore[bad-argument-type]


@pytest.mark.slow
def test_the_demo_reaches_what_its_page_says(tmp_path):
    made = run(tmp_path)
    plain = {k: made[k] for k in ("name", "title", "figures", "sentences")}
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    value = {f["name"]: (f["value"], f["reference"]) for f in made["figures"]}
    assert value["surrogate, order chosen by blocks left out"][0] == 2
    assert value["surrogate, fit to the raw record"][0] > 98.0
    assert value["J, auto, median of the runs"][0] < value["J, auto, median of the runs"][1]
    assert value["Kb at the lowest J"][0] < 0.3 * TRUTH["Kb"]  # the second error's bias
    assert value["raw record: truth inside 95 %, three coefficients"][0] > 80.0
    inside, total = value["with a current channel: constants inside their intervals"]
    assert total == 5
    assert inside >= 4
