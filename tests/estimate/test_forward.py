"""Windows with starts of their own against a plain nonlinear least-squares fit by scipy."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import plantfit as pf
from plantfit.errors import ModelError, RecordingError
from plantfit.estimate import free_start, windows
from plantfit.fitting import estimate_at
from plantfit.optimize import minimise
from plantfit.study import objective_of

DECAY = pf.equations(
    "x' = -a*x + u",
    inputs=["u"],
    states={"x": {"initial": 2.0}},
    outputs=["x"],
    parameters={"a": {"bounds": (0.1, 5.0)}},
    name="decay",
)


def decay_record(n=241, a=0.8):
    t = np.linspace(0.0, 6.0, n)
    y = 3.0 * np.exp(-a * t) + 0.02 * np.random.default_rng(0).normal(size=n)
    return pf.from_arrays(t, signals={"u": np.zeros(n), "x": y})


def test_windows_part_the_samples():
    record = decay_record()
    parts = windows(record, 2.0)
    assert list(parts) == ["w0", "w1", "w2"]
    assert [len(p) for p in parts.values()] == [80, 80, 80]
    assert np.array_equal(np.concatenate([p["x"] for p in parts.values()]), record["x"][:240])
    with pytest.raises(RecordingError, match="give a shorter one"):
        windows(record, 7.0)


def test_values_and_errors_with_free_starts_are_those_of_scipy():
    record = decay_record()
    model = free_start(DECAY, {"x": 1.0})
    problem = pf.Problem(model, windows(record, 2.0), {"x_start": pf.Parameter((-5.0, 5.0), per_recording=True)}, stepper="rk4", substeps=4)
    best = minimise(objective_of(problem, np.full((1, 4), 0.4)), "least_squares", runs=1, budget=500, seed=0, settings={"agree": 1})[0]
    estimate = estimate_at(problem, best.x, ["a"])

    parts = [(p.t - p.t[0], p["x"]) for p in windows(record, 2.0).values()]

    def residuals(v):
        return np.concatenate([x0 * np.exp(-v[0] * t) - y for x0, (t, y) in zip(v[1:], parts, strict=True)])

    other = least_squares(residuals, np.ones(4))
    covariance = np.linalg.inv(other.jac.T @ other.jac) * 2 * other.cost / (240 - 4)
    assert estimate.values[0] == pytest.approx(other.x[0], rel=1e-5)
    assert estimate.standard_error[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.15)


def test_only_states_can_start_freely():
    with pytest.raises(ModelError, match="no state 'z'"):
        free_start(DECAY, {"z": 1.0})
