"""The exact stepper as a choice of a simulation: linear plants, held and interpolated inputs, dead time."""

import numpy as np
import pytest
from scipy.signal import lsim

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models import equations, first_order
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate import Simulator

PLANT = equations(
    "x1' = x2; x2' = k*u - w^2*x1 - 2*d*w*x2 + c",
    inputs=["u"],
    states={"x1": {"initial": 0.2}, "x2": {"initial": -0.1}},
    outputs=["x1"],
    parameters={
        "k": {"bounds": (1.0, 100.0)},
        "w": {"bounds": (1.0, 200.0)},
        "d": {"bounds": (0.01, 5.0)},
        "c": {"bounds": (-1.0, 1.0)},
    },
)
P = {"k": 30.0, "w": 40.0, "d": 0.05, "c": 0.7}
T = 0.1 * np.arange(60)
U = np.random.default_rng(0).normal(size=60)


@pytest.mark.parametrize("hold", ["previous", "linear"])
def test_one_step_a_sample_is_exact_however_fast_the_plant(hold):
    simulator = Simulator.of(PLANT, stepper="exact", hold={"u": hold})
    y = np.asarray(simulator.outputs(P, simulator.drive(T, {"u": U}))["x1"])
    a = np.array([[0.0, 1.0], [-(P["w"] ** 2), -2 * P["d"] * P["w"]]])
    system = (a, np.array([[0.0, 0.0], [P["k"], 1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 2)))
    inputs = np.column_stack([U, np.full(60, P["c"])])
    _, expected, _ = lsim(system, inputs, T, X0=[0.2, -0.1], interp=hold == "linear")
    np.testing.assert_allclose(y, expected, atol=1e-11)


@pytest.mark.thorough
def test_a_fit_with_dead_time_has_the_derivatives_of_its_exact_answer():
    model = first_order(initial="free")
    values = {"K": 1.7, "tau": 0.35, "L": 0.234, "c": 0.1, "y0": 0.0}
    u = (T > 1.0) * 1.0
    late = np.maximum(T - 1.1 - values["L"], 0.0)  # the input steps at its first sample above 1 s
    rest = values["c"] * (1 - np.exp(-T / values["tau"]))
    y = rest + values["K"] * (1 - np.exp(-late / values["tau"]))
    problem = Problem(model, Recording(T, {"u": Signal(u), "y": Signal(y)}), stepper="exact")
    z = problem.space.cube(problem.space.vector(values))
    np.testing.assert_allclose(problem.residuals_and_jacobian(z)[0], 0.0, atol=1e-12)
    moved = z + 0.01
    r, jacobian = problem.residuals_and_jacobian(moved)
    _, gradient = problem.value_and_gradient(moved)
    np.testing.assert_allclose(gradient, 2 * jacobian.T @ r / len(r), rtol=1e-8, atol=1e-12)
    h = 1e-6
    numeric = [
        (float(problem.cost(moved + h * e)) - float(problem.cost(moved - h * e))) / (2 * h) for e in np.eye(len(z))
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-7)


def test_a_nonlinear_model_is_refused_in_one_sentence():
    model = equations(
        "x' = -k*x^3", states={"x": {"initial": 1.0}}, outputs=["x"], parameters={"k": {"bounds": (0.1, 1.0)}}
    )
    with pytest.raises(SimulationError, match="no step is exact"):
        Simulator.of(model, stepper="exact")
