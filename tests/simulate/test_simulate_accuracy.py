"""Accuracy of the steppers: order against matrix exponentials, damping of stiff decays, estimates of the error."""

import numpy as np
import pytest
from scipy.linalg import expm
from simulate_plants import P, exact, record, stiff

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Model
from plantfit.simulate import Simulator
from plantfit.simulate.check.verify import check_steps, doubling_error
from plantfit.simulate.steps.registry import ADAPTIVE, EXACT, FIXED, STEPPERS
from plantfit.simulate.steps.steppers import factored

import jax
import jax.numpy as jnp

A = np.array([[-1.0, 2.0, 0.0], [-2.0, -0.5, 0.3], [0.4, 0.0, -3.0]])
B = np.array([1.0, -0.5, 0.8])
X0 = np.array([1.0, 0.0, -0.5])
T = np.arange(0.0, 4.01, 0.2)
U = np.cos(T) + 0.3 * np.sin(5.0 * T)


def linear_system(swing: float = 0.0) -> Model:
    """x' = A x + B (u + swing sin 2t)."""

    def derivative(x, u, p):
        force = u["u"] + swing * jnp.sin(2.0 * u["t"]) if swing else u["u"]
        return {f"x{i}": sum(A[i, j] * x[f"x{j}"] for j in range(3)) + B[i] * force for i in range(3)}

    names = [f"x{i}" for i in range(3)]
    return Model(
        name="linear",
        states=dict.fromkeys(names),
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("unused"),),
        derivative=derivative,
        output=lambda x, u, p: {"y": x["x0"]},
        initial_state=lambda p, u0, y0: dict(zip(names, X0, strict=True)),
    )


def exact_linear(hold: str, swing: float) -> np.ndarray:
    """States (3, n): matrix exponential over x, u, du/dt, swing sin 2t, swing cos 2t."""
    big = np.zeros((7, 7))
    big[:3, :3], big[:3, 3], big[:3, 5] = A, B, B
    big[3, 4], big[5, 6], big[6, 5] = 1.0, 2.0, -2.0
    step = expm(big * (T[1] - T[0]))
    x, found = X0, [X0]
    for k in range(len(T) - 1):
        slope = (U[k + 1] - U[k]) / (T[k + 1] - T[k]) if hold == "linear" else 0.0
        x = (step @ np.r_[x, U[k], slope, swing * np.sin(2 * T[k]), swing * np.cos(2 * T[k])])[:3]
        found.append(x)
    return np.array(found).T


def test_steppers_without_a_function_of_their_own_have_a_file_of_tests():
    assert {*STEPPERS} - {*FIXED} == {EXACT, ADAPTIVE}, "test_exact_stepper.py and test_adaptive_steps.py are of these"


@pytest.mark.parametrize("stepper", FIXED)
@pytest.mark.parametrize(("hold", "swing"), [("previous", 0.0), ("linear", 0.0), ("previous", 1.0), ("linear", 1.0)])
@pytest.mark.further(2)
def test_order_of_convergence(stepper, hold, swing):
    """Of a linear rate without time some steppers have a higher order than the registry says."""
    expected, order = exact_linear(hold, swing), STEPPERS[stepper].order
    fewest = round(2.0 ** (8 - 1.5 * order))  # 32 for order 2, 4 for order 4: small errors, yet far above rounding
    errors = []
    for substeps in (fewest, 2 * fewest, 4 * fewest):
        simulator = Simulator.of(linear_system(swing), stepper=stepper, substeps=substeps, hold={"u": hold})
        states = np.array(simulator.states({"unused": 0.0}, simulator.drive(T, {"u": U})))
        errors.append(np.max(np.abs(states - expected)))
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(slopes > order - 0.1), errors
    assert not swing or slopes == pytest.approx(order, abs=0.1), errors


def decay() -> Model:
    return Model(
        name="decay",
        states={"x": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("rate"),),
        derivative=lambda x, u, p: {"x": p["rate"] * (u["u"] - x["x"])},
        output=lambda x, u, p: {"y": x["x"]},
        initial_state=lambda p, u0, y0: {"x": 1.0},
    )


@pytest.mark.parametrize("rate", [1e3, 1e6, 1e9, 1e12])
def test_rosenbrock_is_l_stable(rate):
    simulator = Simulator.of(decay())
    y = np.asarray(simulator.outputs({"rate": rate}, simulator.drive(np.arange(4.0), {"u": np.zeros(4)}))["y"])
    # at infinity the amplification is about (1 + sqrt 2) (2 / rate) for gamma = 1 - 1/sqrt 2; held well under by 20 /
    # rate
    assert abs(y[1]) < 20.0 / rate
    assert np.all(np.abs(y[2:]) <= abs(y[1]))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_small_solver_equals_numpy(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        matrix, right = rng.normal(size=(n, n)), rng.normal(size=n)
        if n >= 3:
            matrix[0, 0] = matrix[1, 1] = 0.0  # needs pivots
        ours = factored([[jnp.asarray(v) for v in row] for row in matrix])(list(right))
        expected = np.linalg.solve(matrix, right)
        np.testing.assert_allclose(
            ours, expected, rtol=1e-11 * np.linalg.cond(matrix), atol=1e-13 * np.linalg.cond(matrix)
        )


def test_a_chain_of_four_states_with_zero_pivots_follows_its_exponential():
    chain = np.array([[0.0, 1.0, 0.0, 0.0], [-9.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 50.0], [0.0, 0.0, -50.0, -400.0]])
    names = [f"x{i}" for i in range(4)]
    model = Model(
        name="chain",
        states=dict.fromkeys(names),
        inputs={},
        outputs={"y": None},
        parameters=(),
        derivative=lambda x, u, p: {
            n: sum(chain[i, j] * x[m] for j, m in enumerate(names)) for i, n in enumerate(names)
        },
        output=lambda x, u, p: {"y": x["x0"]},
        initial_state=lambda p, u0, y0: dict.fromkeys(names, 1.0),
    )
    simulator = Simulator.of(model, substeps=64)
    t = np.linspace(0.0, 2.0, 41)
    y = simulator.outputs({}, simulator.drive(t, {}))["y"]
    expected = [(expm(chain * s) @ np.ones(4))[0] for s in t]
    np.testing.assert_allclose(y, expected, atol=2e-4)


@pytest.mark.parametrize("hold", ["previous", pytest.param("linear", marks=pytest.mark.slow)])
def test_step_doubling_estimates_the_true_error(hold):
    t, u = record()
    simulator = Simulator.of(stiff(), substeps=4, hold={"u": hold})
    p = {k: float(v) for k, v in P.items()}
    drive = simulator.drive(t, {"u": u})
    ours = jax.jit(lambda p: simulator.outputs(p, drive)["y"])(p)
    true = np.abs(np.asarray(ours) - exact(p, t, u, hold)[1])
    estimate = doubling_error(simulator, p, drive)["y"]
    assert np.sqrt(np.mean(estimate**2)) == pytest.approx(np.sqrt(np.mean(true**2)), rel=0.3)
    checked = check_steps(simulator, p, drive)
    assert checked.max_error["y"] == pytest.approx(np.max(true), rel=1e-2)
    assert checked.rms_error["y"] == pytest.approx(np.sqrt(np.mean(true**2)), rel=1e-2)
    assert (checked.first, checked.last) == (0, len(t) - 1)


def test_the_check_of_a_long_record_says_how_far_it_went():
    t, u = record()
    simulator = Simulator.of(stiff())
    checked = check_steps(
        simulator, {k: float(v) for k, v in P.items()}, simulator.drive(t, {"u": u}), evaluations=2000
    )
    assert 0 < checked.last < len(t) - 1
    assert checked.stopped is None


def test_a_batch_equals_its_members():
    t, u = record()
    simulator = Simulator.of(stiff())
    drive = simulator.drive(t, {"u": u})
    factors = np.linspace(0.8, 1.2, 7)
    batch = {k: jnp.asarray(v * factors) for k, v in P.items()}
    together = jax.jit(jax.vmap(lambda p: simulator.outputs(p, drive)["y"]))(batch)
    single = jax.jit(lambda p: simulator.outputs(p, drive)["y"])
    for i, row in enumerate(together):
        np.testing.assert_allclose(row, single({k: v[i] for k, v in batch.items()}), rtol=1e-11, atol=1e-13)
