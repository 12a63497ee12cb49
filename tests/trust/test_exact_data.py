"""Data without noise, as of a first simulated trial: what they leave open is open, and what they fix is fixed."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.intervals.covariance import inverse_beside

TRUTH = {"a": 3.0, "b": 2.0, "R": 1.5, "k": 1.0, "c": 0.5, "d": 7.0}


def statuses(text, names, noise, seed):
    rng = np.random.default_rng(seed)
    u, v = rng.normal(size=(2, 200))
    y = eval(text.removeprefix("y = "), {}, {"u": u, "v": v, **TRUTH}) + noise * rng.normal(size=200)
    model = equations(text, inputs=["u", "v"], outputs=["y"], parameters=list(names))
    record = Recording(np.arange(200.0), {"u": Signal(u), "v": Signal(v), "y": Signal(y)})
    problem = Problem(model, record, {n: Parameter((1e-3, 100.0), scale="log") for n in names})
    return {r["name"]: r["status"] for r in fit(problem, seed=seed).findings["parameters"]}


@pytest.mark.parametrize("noise", [0.0, 1e-8, 1e-6])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.thorough
def test_products_stay_open_however_exact_the_data(noise, seed):
    """It was a LinAlgError: the prior of the box was less than the rounding of the data."""
    found = statuses("y = a*b*u + c*d*v", "abcd", noise, seed)
    assert "determined" not in found.values()


@pytest.mark.parametrize("noise", [0.0, 1e-8])
@pytest.mark.thorough
def test_a_sum_with_a_ratio_stays_open_too(noise):
    found = statuses("y = (a + R*b/k)*u + R/k*v", ("a", "b", "R", "k"), noise, 1)
    assert "determined" not in found.values()


@pytest.mark.parametrize("noise", [0.0, 1e-8, 1e-6])
def test_what_the_data_fix_is_determined(noise):
    assert set(statuses("y = a*u + c*v", "ac", noise, 1).values()) == {"determined"}


@pytest.mark.parametrize("exact", [1.0, 1e6, 1e18, 1e24])
def test_the_inverse_has_the_prior_along_what_is_open(exact):
    """Of a known direction q and the rest, in closed form; a prior of 12 is rounding beside 1e18."""
    q = np.array([3.0, -1.0, 2.0]) / np.sqrt(14.0)
    known = np.outer(q, q)
    found = inverse_beside(exact * known, 12.0 * np.eye(3))
    expected = known / (exact + 12.0) + (np.eye(3) - known) / 12.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
