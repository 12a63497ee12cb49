"""A simulation can be finite where terms of its derivatives overflow: x^n log(x) with n = 62 and x = 9e4."""

import numpy as np
import pytest

from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.problem.evaluate import points
from plantfit.recording.record import Recording, Signal
from plantfit.trust.finish.descent import descent
from plantfit.trust.intervals.linearised import linearise

TRUTH = {"a": 3.0, "n": 62.0, "tau": 2.0}


@pytest.fixture(scope="module")
def problem():
    """A repressed product: z falls from 9e4 to below K = 20, and production begins."""
    t = np.linspace(0.0, 60.0, 61)
    model = equations(
        "z' = -z/5\nx' = (a*20^n/(20^n + z^n) - x)/tau\ny = x",
        inputs=[],
        states={"z": {"initial": 9e4}, "x": {"initial": 0.0}},
        outputs=["y"],
        parameters={"a": {"bounds": (0.5, 10.0)}, "n": {"bounds": (61.0, 63.0)}, "tau": {"bounds": (0.5, 10.0)}},
        check=False,
    )
    clean = Problem(model, Recording(t, {"y": Signal(0.0 * t)}), substeps=16).predict(np.array(list(TRUTH.values())))[
        "y"
    ]
    noise = 0.02 * np.random.default_rng(4).normal(size=len(t))
    return Problem(model, Recording(t, {"y": Signal(clean + noise)}), substeps=16)


def test_columns_that_are_no_numbers_become_differences(problem):
    z = np.asarray(problem.space.cube(np.array(list(TRUTH.values()))))
    exact = np.asarray(problem.residuals_and_jacobian(z)[1])
    bad = ~np.all(np.isfinite(exact), axis=0)
    assert list(bad) == [False, True, False]
    r, jacobian = points.residuals_and_jacobian(problem, z)
    assert np.all(np.isfinite(r))
    assert np.array_equal(jacobian[:, ~bad], exact[:, ~bad])
    step = 1e-4 * np.eye(3)[1]
    slope = (np.asarray(problem.residuals(z + step)) - np.asarray(problem.residuals(z - step))) / 2e-4
    assert np.allclose(jacobian[:, 1], slope, rtol=1e-3, atol=1e-6 * np.max(np.abs(slope)))
    assert np.max(np.abs(slope)) > 0.0


def test_cost_and_standard_errors_there_are_numbers(problem):
    z = np.asarray(problem.space.cube(np.array(list(TRUTH.values()))))
    assert descent(problem, z, evaluations=1).cost == pytest.approx(float(problem.cost(z)), rel=0.2)
    local = linearise(problem, z)
    assert np.all(np.isfinite(local.covariance))
    assert 0.0 < local.standard_error[0] < 0.1
