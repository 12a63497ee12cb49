"""Answers with what the data leave open drawn anew fit as well as the answer itself."""

from functools import cache

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.errors import SearchError
from plantfit.trust import open_answers


@cache
def problem(free):
    """y = a t, and a parameter b of an input that stayed at 0."""
    t = np.linspace(0.0, 5.0, 60)
    y = 2.0 * t + np.random.default_rng(1).normal(0, 0.05, 60)
    model = equations(
        "x' = a + b*u\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["a", "b"], name="ramp"
    )
    parameters = {"a": Parameter((0.0, 5.0)), "b": Parameter((0.0, 1.0)) if free else Parameter(value=0.3)}
    return Problem(model, Recording(t, {"u": Signal(np.zeros(60), None), "y": Signal(y, None)}, "run"), parameters)


def test_only_what_is_open_moves_and_fits_as_well():
    p = problem(free=True)
    z = np.array([0.4, 0.5])
    drawn = open_answers(p, z, 400, seed=2)
    assert np.all(drawn[:, 0] == 0.4)
    assert drawn[:, 1].mean() == pytest.approx(0.5, abs=0.06)
    assert drawn[:, 1].std() == pytest.approx(12**-0.5, rel=0.1)
    np.testing.assert_allclose(p.costs(drawn), float(p.cost(z)), rtol=1e-9)
    np.testing.assert_array_equal(drawn, open_answers(p, z, 400, seed=2))


def test_nothing_open_is_said():
    with pytest.raises(SearchError, match="fix every parameter"):
        open_answers(problem(free=False), np.array([0.4]), 3)
    with pytest.raises(SearchError, match="count = 0"):
        open_answers(problem(free=True), np.array([0.4, 0.5]), 0)


def test_copies_stay_as_near_as_the_cost_allows():
    p = problem(free=True)
    at = np.array([0.4, 0.5])  # a = 2
    drawn = open_answers(p, at, 200, known=1.1, worst=3.0, seed=2)  # both count as open
    costs = np.asarray(p.costs(drawn))
    assert np.all(costs <= 3.0 * float(p.cost(at)))
    assert np.median(costs) > 1.05 * float(p.cost(at))  # none is nearer than it has to be by more than a half
    assert drawn[:, 0].std() > 1e-4
    with pytest.raises(SearchError, match=r"worst = 0\.5"):
        open_answers(p, at, 3, worst=0.5)
