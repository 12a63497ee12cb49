"""Steady records: alone, and in one fit with moving ones."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit import fit
from plantfit.models import equations
from plantfit.problem import Experiment, Problem
from plantfit.problem.evaluate.record_by_record import RecordByRecord
from plantfit.recording.record import Recording, Signal

TRUTH = {"K": 2.0, "c": 0.3, "tau": 1.5}


def model():
    """x' = (K tanh u - x - c x^3)/tau: at rest K tanh u = x + c x^3, in which tau does not appear."""
    return equations(
        "x' = (K*tanh(u) - x - c*x^3)/tau",
        inputs=["u"],
        states={"x": {"initial": 0.0}},
        outputs=["x"],
        parameters={
            "K": {"bounds": (0.5, 5.0)},
            "c": {"bounds": (0.0, 1.0)},
            "tau": {"bounds": (0.1, 10.0), "scale": "log"},
        },
    )


def curve(shift: float = 0.0):
    """x solves x + c x^3 = K tanh u, by numpy's roots."""
    u = np.linspace(-2.0, 2.0, 21)
    x = [np.real(r[np.isreal(r)])[0] for r in (np.roots([TRUTH["c"], 0.0, 1.0, -TRUTH["K"] * np.tanh(v)]) for v in u)]
    return Recording(np.arange(21.0), {"u": Signal(u), "x": Signal(np.array(x) + shift)}, "curve")


def run():
    t = np.linspace(0.0, 10.0, 401)
    u = np.where((t // 2.5).astype(int) % 2 == 0, 0.8, -0.4)
    x = np.zeros_like(t)
    for k in range(400):
        z = x[k]
        for _ in range(50):
            z += (t[1] - t[0]) / 50 * (TRUTH["K"] * np.tanh(u[k]) - z - TRUTH["c"] * z**3) / TRUTH["tau"]
        x[k + 1] = z
    return Recording(t, {"u": Signal(u), "x": Signal(x)}, "run")


def test_at_rest_the_model_equals_the_roots_of_its_equation():
    problem = Problem(model(), Experiment(curve(), steady=True))
    z = problem.space.cube(problem.space.vector(TRUTH))
    np.testing.assert_allclose(problem.residuals(z), 0.0, atol=1e-9)
    _, jacobian = problem.residuals_and_jacobian(z)
    np.testing.assert_allclose(jacobian[:, 2], 0.0, atol=1e-12)
    numeric = (
        np.asarray(problem.residuals(z + np.array([1e-6, 0, 0])))
        - np.asarray(problem.residuals(z - np.array([1e-6, 0, 0])))
    ) / 2e-6
    np.testing.assert_allclose(jacobian[:, 0], numeric, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("order", [("run", "curve"), ("curve", "run")])
@pytest.mark.thorough
def test_moving_and_steady_records_in_one_problem_equal_record_by_record(order):
    records = {"run": Experiment(run()), "curve": Experiment(curve(0.05), steady=True)}
    problem = Problem(model(), {n: records[n] for n in order}, substeps=2)
    direct = RecordByRecord(problem.predictor, problem.space, problem.outputs, tuple(problem.data["drive"]))
    z = np.array([0.3, 0.6, 0.4])
    r, j = problem.residuals_and_jacobian(z)
    r0, j0 = direct.residuals_and_jacobian(z, problem.data)
    np.testing.assert_allclose(r, r0, atol=1e-10)
    np.testing.assert_allclose(j, j0, atol=1e-8)
    assert float(problem.cost(z)) == pytest.approx(float(np.mean(np.asarray(r0) ** 2)), rel=1e-10)
    value, gradient = problem.value_and_gradient(z)
    assert value == pytest.approx(float(problem.cost(z)), rel=1e-10)
    np.testing.assert_allclose(gradient, 2 * np.asarray(j0).T @ np.asarray(r0) / len(r0), rtol=1e-7)


def with_noise(record, rms, seed):
    x = record["x"] + rms * np.random.default_rng(seed).standard_normal(len(record))
    return Recording(record.t, {"u": Signal(record["u"]), "x": Signal(x)}, record.name)


# without noise the steps are made so fine that a fit takes three times as long: once is enough
@pytest.mark.parametrize(
    ("order", "noise"),
    [pytest.param(("run", "curve"), 0.0, marks=pytest.mark.slow), (("curve", "run"), 0.002)],
)
@pytest.mark.thorough
def test_a_fit_of_both_finds_all_parameters(order, noise):
    records = {
        "run": Experiment(with_noise(run(), noise, 1)),
        "curve": Experiment(with_noise(curve(), noise, 2), steady=True),
    }
    answer = fit(Problem(model(), {n: records[n] for n in order}), seed=2)
    found = dict(zip(answer.problem.space.names, np.asarray(answer.problem.space.physical(answer.best.x)), strict=True))
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=0.01)
    assert set(answer.findings["simulation"]["outputs"]) == {"x"}
