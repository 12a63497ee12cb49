"""Fits of models with resets, dry friction, backlash and late states: derivatives against differences, and an
answer."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit import fit
from plantfit.errors import SimulationError
from plantfit.models import equations
from plantfit.problem import Problem, verify
from plantfit.recording.record import Recording, Signal

T = np.arange(0.0, 4.0, 0.02)
U = 1.5 * np.sin(2.0 * T) + 0.8 * np.sin(5.3 * T)

CASES = {
    "ball": (
        equations(
            "h' = v; v' = -g\nwhen falling(h): v = -c*v",
            states={"h": {"initial": 1.0}, "v": {"initial": 0.0}},
            outputs=["h"],
            parameters={"g": {"bounds": (5.0, 15.0)}, "c": {"bounds": (0.4, 0.95)}},
            check=False,
        ),
        {"g": 9.2, "c": 0.83},
    ),
    "stick": (
        equations(
            "x' = v; v' = (u - k*x - friction(v, Fc))/m",
            inputs=["u"],
            states={"x": {"initial": 0.0}, "v": {"initial": 0.0}},
            outputs=["x"],
            parameters={"k": {"bounds": (0.5, 4.0)}, "Fc": {"bounds": (0.05, 1.0)}, "m": {"bounds": (0.2, 2.0)}},
            check=False,
        ),
        {"k": 1.7, "Fc": 0.4, "m": 0.6},
    ),
    "late": (
        equations(
            "x' = -a*delay(x, tau) + u",
            inputs=["u"],
            states={"x": {"initial": 0.3}},
            outputs=["x"],
            parameters={"a": {"bounds": (0.3, 3.0)}, "tau": {"bounds": (0.05, 0.6), "unit": "s"}},
            check=False,
        ),
        {"a": 1.3, "tau": 0.31},
    ),
}


def made(name):
    model, truth = CASES[name]
    signals = {"u": Signal(U)} if model.inputs else {}
    output = next(iter(model.outputs))
    blank = Problem(model, Recording(T, {**signals, output: Signal(np.zeros_like(T))}), substeps=2)
    y = blank.predict(blank.space.vector(truth))[output]
    noise = 0.002 * np.random.default_rng(1).standard_normal(len(T))
    return Problem(model, Recording(T, {**signals, output: Signal(y + noise)}), substeps=2), truth


@pytest.mark.parametrize("name", ["ball", pytest.param("stick", marks=pytest.mark.slow), "late"])
@pytest.mark.further(1)
def test_derivatives_equal_differences_and_costs_equal_residuals(name):
    problem, truth = made(name)
    z = problem.space.cube(problem.space.vector(truth)) * 0.97 + 0.01
    r, jacobian = problem.residuals_and_jacobian(z)
    assert float(problem.cost(z)) == pytest.approx(float(np.mean(r**2)), rel=1e-9)
    np.testing.assert_allclose(problem.costs(np.array([z, z, z * 0.99]))[:2], np.mean(r**2), rtol=1e-9)
    value, gradient = problem.value_and_gradient(z)
    assert value == pytest.approx(float(np.mean(r**2)), rel=1e-9)
    np.testing.assert_allclose(gradient, 2.0 * jacobian.T @ r / len(r), rtol=1e-6, atol=1e-9)
    h = 1e-7
    for i in range(len(z)):
        step = h * (np.arange(len(z)) == i)
        after, before = (np.asarray(problem.residuals_and_jacobian(z + s)[0]) for s in (step, -step))
        numeric = (after - before) / (2 * h)
        error = np.sort(np.abs(numeric - jacobian[:, i])) / np.max(np.abs(numeric))
        assert error[-4] < 1e-3  # but where an event passes a sample between the two


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ball", "stick"])
def test_candidates_have_the_same_bits_in_any_batch(name):
    """Of some lanes of a vector something happens in a step, of the others nothing does."""
    problem, truth = made(name)
    z = np.asarray(problem.space.cube(problem.space.vector(truth)))
    several = z + 0.02 * np.random.default_rng(4).standard_normal((19, len(z)))
    costs, gradients = problem.values_and_gradients(several)
    assert np.all(np.isfinite(gradients))
    np.testing.assert_array_equal(costs, problem.costs(several))
    for some in (several[3:5], several[::-1][:11]):
        own = [int(np.flatnonzero((several == one).all(axis=1))[0]) for one in some]
        np.testing.assert_array_equal(problem.costs(some), np.asarray(costs)[own])
        np.testing.assert_array_equal(problem.values_and_gradients(some)[1], np.asarray(gradients)[own])


@pytest.mark.parametrize("name", ["ball", "stick", pytest.param("late", marks=pytest.mark.slow)])
def test_a_fit_finds_the_parameters(name):
    problem, truth = made(name)
    answer = fit(problem, seed=3)
    found = dict(zip(problem.space.names, np.asarray(problem.space.physical(answer.best.x)), strict=True))
    for parameter, value in truth.items():
        assert found[parameter] == pytest.approx(value, rel=0.02), found
    assert answer.best.cost < 2 * 0.002**2


@pytest.mark.parametrize("name", CASES)
def test_the_check_at_the_answer_is_one_that_knows_these_models(name):
    problem, truth = made(name)
    z = problem.space.cube(problem.space.vector(truth))
    (found,) = verify(problem, z, tolerance=2e-4)
    assert found.checked_with.startswith("scipy DOP853 with ")
    assert found.refused is None
    assert found.max_error < 2e-4


@pytest.mark.thorough
def test_late_states_choose_their_own_steps():
    problem, _ = made("late")
    free = Problem(problem.model, problem.experiments["recording"].recording)
    answer = fit(free, seed=1)
    assert np.isfinite(answer.best.cost)
    assert answer.best.cost < 2 * 0.002**2
    assert answer.findings["simulation"]["checked_with"] == "scipy DOP853 with late states, rtol 1e-9"


def test_late_states_with_resets_are_refused_in_one_sentence():
    model = equations(
        "x' = -a*delay(x, tau)\nwhen falling(x): x = 1",
        states={"x": {"initial": 1.0}},
        outputs=["x"],
        parameters={"a": {"bounds": (0.3, 3.0)}, "tau": {"bounds": (0.05, 0.6), "unit": "s"}},
        check=False,
    )
    with pytest.raises(SimulationError, match="late states together with events"):
        Problem(model, Recording(T, {"x": Signal(np.ones_like(T))}))
