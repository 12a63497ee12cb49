"""Draws of parameters that the data allow: their covariance is that of the answer, open ones keep the cost, limits
hold."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.trust.intervals.plausible import plausible


def answered(text, parameters, bounds, noise):
    rng = np.random.default_rng(3)
    t = np.arange(150.0)
    u = np.repeat(rng.uniform(0, 4, 15), 10)
    x, tau, gain = np.zeros(150), 8.0, 2.0
    for k in range(149):
        x[k + 1] = gain * u[k] + (x[k] - gain * u[k]) * np.exp(-1 / tau)
    y = x + rng.normal(0, noise, 150)
    model = pf.equations(
        text, inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"], parameters=parameters, name="lag"
    )
    problem = pf.Problem(model, pf.from_arrays(t, signals={"u": u, "y": y}), bounds)
    return pf.fit(problem, budget=600, seed=1)


def test_draws_have_the_covariance_of_the_answer():
    bounds = {"K": pf.Parameter((0.1, 10.0), scale="log"), "tau": pf.Parameter((1.0, 50.0), scale="log")}
    answer = answered("x' = (K*u - x)/tau\ny = x", ["K", "tau"], bounds, 0.3)
    drawn = plausible(answer.problem, answer.best.x, answer.findings["parameters"], 4000, seed=2)
    assert drawn.open == ()
    assert drawn.values.shape == (4001, 2)
    np.testing.assert_allclose(drawn.values[0], list(answer.values.values()), rtol=1e-12)
    found, truth = np.cov(drawn.values[1:].T), np.asarray(answer.covariance)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.diag(truth)), rtol=0.06)
    assert np.corrcoef(drawn.values[1:].T)[0, 1] == pytest.approx(answer.correlation["K", "tau"], abs=0.06)
    again = plausible(answer.problem, answer.best.x, answer.findings["parameters"], 4000, seed=2)
    np.testing.assert_array_equal(again.values, drawn.values)


def test_what_only_a_product_determines_is_drawn_along_it():
    """K = a b: each alone is open over its box, draws keep the product and with it the cost."""
    bounds = {"a": pf.Parameter((0.2, 20.0), scale="log"), "b": pf.Parameter((0.1, 10.0), scale="log"),
              "tau": pf.Parameter((1.0, 50.0), scale="log")}  # fmt: skip
    answer = answered("x' = (a*b*u - x)/tau\ny = x", ["a", "b", "tau"], bounds, 0.1)
    drawn = plausible(answer.problem, answer.best.x, answer.findings["parameters"], 100, seed=2)
    assert drawn.open
    a, b, _ = drawn.values.T
    best = answer.values["a"] * answer.values["b"]
    assert np.ptp(np.log(a)) > 1.0
    np.testing.assert_allclose(a * b, best, rtol=0.05)
    costs = np.asarray(answer.problem.costs(answer.problem.space.cube(drawn.values)))
    assert np.max(costs) < 1.15 * costs[0]


def test_what_is_determined_is_drawn_from_the_covariance_alone(monkeypatch):
    """No walk begins: `plausible` is as quick as before and has the same bits."""
    bounds = {"K": pf.Parameter((0.1, 10.0), scale="log"), "tau": pf.Parameter((1.0, 50.0), scale="log")}
    answer = answered("x' = (K*u - x)/tau\ny = x", ["K", "tau"], bounds, 0.1)
    rows = answer.findings["parameters"]
    before = plausible(answer.problem, answer.best.x, rows, 50, seed=2)
    monkeypatch.setattr("plantfit.trust.intervals.plausible.by_likelihood", lambda *a: pytest.fail("walked"))
    np.testing.assert_array_equal(plausible(answer.problem, answer.best.x, rows, 50, seed=2).values, before.values)
    with pytest.raises(pytest.fail.Exception, match="walked"):
        plausible(answer.problem, answer.best.x, [{**r, "status": "weak"} for r in rows], 50, seed=2)


def test_draws_that_seldom_lie_within_all_limits_are_made_until_there_are_enough(monkeypatch):
    """Of many coordinates most draws leave some limit; only where the cost refuses nearly all is it given up."""
    import plantfit.trust.intervals.plausible as module
    from plantfit.errors import SearchError

    bounds = {"a": pf.Parameter((0.2, 20.0), scale="log"), "b": pf.Parameter((0.1, 10.0), scale="log"),
              "tau": pf.Parameter((1.0, 50.0), scale="log")}  # fmt: skip
    answer = answered("x' = (a*b*u - x)/tau\ny = x", ["a", "b", "tau"], bounds, 0.1)
    rows = answer.findings["parameters"]
    monkeypatch.setattr(module, "by_likelihood", lambda *a: None)
    inside = module._Around._inside

    def seldom(self, found, move, limits):  # as of 31 coordinates: one in 300 draws lies within all limits
        return inside(self, found, move, limits) & (self.rng.uniform(size=len(found)) < 1 / 300)

    monkeypatch.setattr(module._Around, "_inside", seldom)
    drawn = plausible(answer.problem, answer.best.x, rows, 100, seed=2)
    assert drawn.values.shape == (101, 3)
    monkeypatch.setattr(module, "MORE_ROUNDS", 0)
    with pytest.raises(
        SearchError, match=r"Of \d+ draws of the parameters within their limits \d+ have a cost that the data allow"
    ):
        plausible(answer.problem, answer.best.x, rows, 100, seed=2)
