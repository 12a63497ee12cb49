"""Regressions of several outputs through nonlinear physical parameters: compressed costs, derivatives, intervals,
study file."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import plantfit as pf
from plantfit.models import Declared, LinearModel
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.models.library.pendubot_terms import base_values
from plantfit.problem import Problem
from plantfit.recording import Recording
from plantfit.recording.record import Signal
from plantfit.spec import load
from plantfit.study.objective import objective_of

TRUTH = {"m1": 0.21, "m2": 0.1, "lc1": 0.12, "lc2": 0.15, "I1": 0.00053, "I2": 0.00077}
SIGMA = {"tau1": 0.015, "tau2": 0.004}


def record(n=600, seed=0, joints=(1, 2), name="swing"):
    """Two joints in a swing of sines, torques with noise."""
    model = pendubot_regression(joints=joints)
    t, rng = 0.01 * np.arange(n), np.random.default_rng(seed)
    s: dict[str, Any] = {}
    for joint, waves in ((1, [(0.7, 1.3), (0.3, 4.1)]), (2, [(0.9, 2.2), (0.2, 7.0)])):
        phases = rng.uniform(0, 6, len(waves))
        terms = [(a, w, w * t + f) for (a, w), f in zip(waves, phases, strict=True)]
        s[f"theta{joint}"] = sum(a * np.sin(x) for a, w, x in terms)
        s[f"omega{joint}"] = sum(a * w * np.cos(x) for a, w, x in terms)
        s[f"alpha{joint}"] = sum(-a * w * w * np.sin(x) for a, w, x in terms)
    torque = {o: model.predict(s, TRUTH, o) + rng.normal(0, SIGMA[o], n) for o in model.outputs}
    units = {**model.signals, **model.outputs}
    return Recording(t, {n: Signal(v, units[n]) for n, v in {**s, **torque}.items()}, name)


@pytest.fixture(scope="module")
def problem():
    other = record(250, seed=5, name="other")
    gappy = np.where(np.arange(250) % 7, other["tau2"], np.nan)
    holes = {**other.signals, "tau2": Signal(gappy, "N*m")}
    recordings = {"swing": record(), "other": Recording(other.t, holes, "other")}
    return Problem(pendubot_regression(joints=(1, 2)), recordings, scales=SIGMA)


def by_hand(problem, values):
    """Scaled residuals of every sample, from the model's own prediction of each row."""
    parts, p = [], dict(zip(problem.space.names, values, strict=True))
    for e in problem.experiments.values():
        for o in ("tau1", "tau2"):
            r = problem.model.predict({n: e.recording[n] for n in problem.model.signals}, p, o) - e.recording[o]
            parts.append(r[np.isfinite(r)] / SIGMA[o])
    return np.concatenate(parts)


def test_cost_is_the_mean_over_every_sample_of_every_output(problem):
    zs = np.random.default_rng(1).uniform(size=(5, 6))
    expected = [np.mean(by_hand(problem, np.asarray(problem.space.physical(z))) ** 2) for z in zs]
    np.testing.assert_allclose(problem.costs(zs), expected, rtol=1e-11)
    np.testing.assert_allclose(
        problem.residuals(zs[0]), by_hand(problem, np.asarray(problem.space.physical(zs[0]))), rtol=1e-10
    )


def test_gradient_and_compressed_rows_are_those_of_all_samples(problem):
    z = np.random.default_rng(2).uniform(size=6)
    r, jacobian = problem.residuals_and_jacobian(z)
    gradient = 2 * jacobian.T @ r / len(r)
    np.testing.assert_allclose(
        problem.value_and_gradient(z)[1], gradient, rtol=1e-9, atol=1e-9 * np.abs(gradient).max()
    )
    short, slopes = problem.compressed(z)
    assert len(short) < 20
    np.testing.assert_allclose(short @ short / len(short), r @ r / len(r), rtol=1e-11)
    np.testing.assert_allclose(slopes.T @ slopes / len(short), jacobian.T @ jacobian / len(r), rtol=1e-9, atol=1e-6)
    step = 1e-6
    slope = [(problem.costs([z + step * e])[0] - problem.costs([z - step * e])[0]) / (2 * step) for e in np.eye(6)]
    np.testing.assert_allclose(gradient, slope, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())


def test_a_search_sees_few_rows_whatever_the_number_of_samples(problem):
    objective = objective_of(problem)
    assert objective.batch_rows is not None
    z = np.random.default_rng(3).uniform(size=(3, 6))
    r, _ = objective.batch_rows(z)
    assert r.shape == (3, 2 * 2 * 5)
    np.testing.assert_allclose(np.mean(np.asarray(r) ** 2, axis=1), problem.costs(z), rtol=1e-11)


def test_bounded_fit_ends_where_scipy_does(problem):
    recordings = {n: e.recording for n, e in problem.experiments.items()}
    base = Problem(pendubot_regression(joints=(1, 2), parameters="base"), recordings, scales=SIGMA)
    x = least_squares(
        lambda p: by_hand(base, p),
        0.5 * (base.space.lower + base.space.upper),
        bounds=(base.space.lower, base.space.upper),
        x_scale="jac",
    ).x
    found = pf.minimise(objective_of(base), "least_squares", runs=2, budget=600, seed=4)
    for run in found:
        np.testing.assert_allclose(base.space.physical(run.x), x, rtol=1e-6)


def test_inertias_stay_open_and_base_parameters_come_within_their_errors():
    recording = record(2000, seed=8)
    physical = pf.fit(Problem(pendubot_regression(joints=(1, 2)), recording), "least_squares", budget=2000, seed=1)
    rows = {p["name"]: p for p in physical.findings["parameters"]}
    for name in ("I1", "I2"):  # where in the open valley a search ends depends on rounding, how far it reaches does not
        assert rows[name]["status"] in ("flat", "weak")
        assert rows[name]["low"] < 1e-4
        assert rows[name]["high"] > 9e-4
    base = pf.fit(
        Problem(pendubot_regression(joints=(1, 2), parameters="base"), recording), "least_squares", budget=2000, seed=1
    )
    truth = base_values(TRUTH)
    for p in base.findings["parameters"]:
        assert p["status"] == "determined"
        assert abs(p["value"] - truth[p["name"]]) < 4 * p["standard_error"]
        assert p["standard_error"] < 0.05 * p["value"]


def test_the_standard_error_is_that_of_weighted_least_squares():
    """White noise and a linear problem: (X' W X)^-1, within what an autocorrelation estimate of white residuals
    costs."""
    recording = record(4000, seed=9)
    model = pendubot_regression(joints=(1, 2), parameters="base")
    answer = pf.fit(Problem(model, recording), "least_squares", budget=2000, seed=1)
    signals = {n: recording[n] for n in model.signals}
    information = sum(x.T @ x / SIGMA[o] ** 2 for o, x in model.blocks(signals).items())
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    found = [p["standard_error"] for p in answer.findings["parameters"]]
    np.testing.assert_allclose(found, expected, rtol=0.25)


def test_an_array_parameter_may_feed_several_coefficients():
    model = LinearModel(
        "curve",
        {"y": "V"},
        (Declared("k", "V", (-2.0, 2.0), shape=(3,)),),
        lambda s: np.stack([np.ones_like(s["x"]), s["x"], s["x"] ** 2], -1),
        {"x": None},
        coefficients={"c0": "V", "c1": "V", "c2": "V"},
        base=lambda p: {f"c{i}": p["k"][i] for i in range(3)},
    )
    x = np.linspace(-1, 1, 50)
    y = 0.3 - 0.8 * x + 1.1 * x**2
    answer = pf.fit(
        Problem(model, Recording(x + 2.0, {"x": Signal(x, None), "y": Signal(y, "V")})), "least_squares", budget=500
    )
    np.testing.assert_allclose([answer.values[f"k[{i}]"] for i in range(3)], [0.3, -0.8, 1.1], rtol=1e-8)


def test_a_study_file_can_name_it(tmp_path):
    r = record(300, seed=2)
    names = list(r.signals)
    rows = np.column_stack([r.t, *(r[n] for n in names)])
    np.savetxt(tmp_path / "swing.csv", rows, delimiter=",", header=",".join(["t", *names]), comments="")
    (tmp_path / "study.toml").write_text(
        """
name = "swing"
[recording.swing]
file = "swing.csv"
time = "t"
[model]
kind = "pendubot_regression"
options = { joints = [1, 2], parameters = "base" }
[search]
methods = ["least_squares"]
""",
        encoding="utf-8",
    )
    study = load(tmp_path / "study.toml")
    assert set(study.problem.outputs) == {"tau1", "tau2"}
    assert float(study.problem.costs(np.full((1, 4), 0.3))[0]) > 0
