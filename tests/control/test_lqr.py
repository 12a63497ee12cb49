"""Regulators and filters against python-control, their own optimality, and a loop written out."""

import numpy as np
import pytest
from plants import CARTS, PERIOD, STICK, carts, quadratic_cost, stick, straight, upright
from scipy.integrate import quad_vec
from scipy.linalg import expm

import control
from plantfit.control import discretised, kalman_observer, linearised, lqr, mpc, pid_per_output
from plantfit.control.linear.kalman import sampled_noise
from plantfit.errors import SimulationError
from plantfit.simulate.loop.sensors import Actuator, Sensor


def test_gains_equal_python_control():
    plant = linearised(carts(), CARTS)
    sampled = discretised(plant, PERIOD)
    q, r = np.diag([4.0, 0.0, 1.0, 0.0]), np.array([[1.0, 0.2], [0.2, 3.0]])
    estimator = kalman_observer(plant, PERIOD, {"v": 0.3, "w": 0.1}, {"s": 1e-3, "q": 2e-3})
    ours = lqr(plant, PERIOD, {"q": 4.0, "v": 1.0}, r, estimator=estimator)
    theirs, _, _ = control.dlqr(sampled.A, sampled.B, q, r)
    np.testing.assert_allclose(ours.parameters.gain, theirs, rtol=1e-8, atol=1e-10)
    noise = sampled_noise(plant.A, np.diag([0.0, 0.0, 0.09, 0.01]), PERIOD)
    # dlqe's gain is that of the state predicted for the next sample
    l_gain, _, _ = control.dlqe(sampled.A, np.eye(4), sampled.C, noise, np.diag([1e-6, 4e-6]))
    np.testing.assert_allclose(sampled.A @ estimator.gain, l_gain, rtol=1e-7, atol=1e-9)


def test_sampled_noise_is_its_integral():
    a, density = np.array([[0.0, 1.0], [9.0, -0.5]]), np.diag([0.2, 3.0])
    integral, _ = quad_vec(lambda s: expm(a * s) @ density @ expm(a * s).T, 0.0, 0.3, epsabs=1e-13)
    np.testing.assert_allclose(sampled_noise(a, density, 0.3), integral, rtol=1e-9)


def test_no_other_gain_costs_less():
    plant = linearised(straight(("q", "w")), STICK)
    q, r = np.diag([1.0, 0.1]), np.array([[2.0]])
    design = lqr(plant, PERIOD, q, r)
    loop = design.close(straight(("q", "w")))

    def cost(change):
        parameters = design.parameters._replace(gain=design.parameters.gain * np.array([change]))
        seen = loop.simulate(parameters, STICK, {}, samples=600, x0={"q": 0.3, "w": -1.0})
        return quadratic_cost(seen.states, seen.u, q, r)

    best = cost((1.0, 1.0))
    _, riccati, _ = control.dlqr(discretised(plant, PERIOD).A, discretised(plant, PERIOD).B, q, r)
    assert best == pytest.approx(np.array([0.3, -1.0]) @ riccati @ [0.3, -1.0], rel=1e-9)
    assert min(cost((1.05, 1.0)), cost((0.97, 1.0)), cost((1.0, 1.05)), cost((1.0, 0.97))) > best


def test_the_loop_equals_one_written_out():
    plant, n = upright(), 150
    estimator = kalman_observer(plant, PERIOD, {"w": 0.5}, 1e-3)
    design = lqr(plant, PERIOD, {"q": 1.0}, {"u": 0.1}, estimator=estimator, limits=(-0.15, 0.15))
    loop = design.close(straight(), sensor=Sensor(quantum=2e-3), actuator=Actuator(-0.15, 0.15))
    wanted = {"q": np.where(np.arange(n) < 70, 0.05, -0.02), "u": -0.01}
    ours = loop.simulate(
        design.parameters, STICK, wanted, x0={"q": 0.1}, noise={"q": 1e-3 * np.random.default_rng(4).normal(size=n)}
    )
    noise = 1e-3 * np.random.default_rng(4).normal(size=n)
    sampled, gain, k = discretised(plant, PERIOD), np.asarray(estimator.gain), np.asarray(design.parameters.gain)
    x, guess, seen = np.array([0.1, 0.0]), np.array([2e-3 * np.round((0.1 + noise[0]) / 2e-3), 0.0]), []
    for j in range(n):
        measured = 2e-3 * np.round((x[0] + noise[j]) / 2e-3)
        guess = guess + gain[:, 0] * (measured - guess[0])
        u = np.clip(-0.01 - (k @ (guess - [wanted["q"][j], 0.0]))[0], -0.15, 0.15)
        seen.append((x[0], u))
        guess, x = sampled.A @ guess + sampled.B[:, 0] * u, sampled.A @ x + sampled.B[:, 0] * u
    seen = np.array(seen)
    np.testing.assert_allclose(ours.y["q"][:60], seen[:60, 0], atol=1e-9)
    np.testing.assert_allclose(ours.u["u"][:60], seen[:60, 1], atol=1e-7)
    assert abs(float(np.mean(ours.y["q"][-20:])) + 0.02) < 0.02
    assert float(np.min(ours.u["u"])) == -0.15


def test_a_filter_estimates_as_well_as_it_says():
    plant = linearised(straight(), STICK | {"a": -20.0})
    sampled = discretised(plant, PERIOD)
    estimator = kalman_observer(plant, PERIOD, {"w": 0.5}, 0.01)
    rng, noise = np.random.default_rng(0), sampled_noise(plant.A, np.diag([0.0, 0.25]), PERIOD)
    x, guess, errors = np.zeros(2), np.zeros(2), []
    factor, gain = np.linalg.cholesky(noise + 1e-15 * np.eye(2)), np.asarray(estimator.gain)[:, 0]
    for _ in range(40_000):
        guess = guess + gain * (x[0] + 0.01 * rng.normal() - guess[0])
        errors.append(x - guess)
        x, guess = sampled.A @ x + factor @ rng.normal(size=2), sampled.A @ guess
    _, before, _ = control.dlqe(sampled.A, np.eye(2), sampled.C, noise, np.array([[1e-4]]))
    said = (np.eye(2) - np.outer(gain, [1.0, 0.0])) @ before
    np.testing.assert_allclose(np.cov(np.array(errors).T), said, rtol=0.06)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lqr(upright(), PERIOD, {"q": 1.0}, {"u": 1.0}), r"kalman_observer\(\.\.\.\)"),
        (lambda: lqr(upright(("q", "w")), PERIOD, {"z": 1.0}, {"u": 1.0}), "Q names 'z'"),
        (lambda: lqr(upright(("q", "w")), PERIOD, {"q": 1.0}, {"u": 0.0}), "weights above 0"),
        (lambda: lqr(upright(("q", "w")), PERIOD, {"q": -1.0}, 1.0), "of at least 0"),
        (lambda: lqr(upright(("q", "w")), PERIOD, np.eye(3), 1.0), r"shape \(3, 3\)"),
        (lambda: lqr(upright(("q", "w")), PERIOD, 1.0, 1.0, limits=(1.0, -1.0)), r"\[1, -1\]"),
        (lambda: lqr(linearised(stick(("q", "w")), STICK | {"b": 0.0}), PERIOD, 1.0, 1.0), "No regulator exists"),
        (lambda: kalman_observer(upright(), PERIOD, 0.0, 1.0), "process = 0"),
        (lambda: kalman_observer(upright(), PERIOD, 1.0, {"q": 0.0}), "measurement = "),
        (
            lambda: kalman_observer(linearised(stick(("w",)), STICK | {"a": 0.0}), PERIOD, 1.0, 1.0),
            "No steady Kalman filter",
        ),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(SimulationError, match=words):
        call()


@pytest.mark.parametrize(("reference", "words"), [(0.0, "may name"), ({"q": 0.0, "u": 0.1, "Q": 1.0}, "names 'Q'")])
def test_a_reference_that_does_not_fit_is_named(reference, words):
    for design in (
        lqr(upright(("q", "w")), PERIOD, 1.0, 1.0),
        mpc(upright(("q", "w")), PERIOD, 1.0, 1.0, limits=None, horizon=3),
        pid_per_output(upright(), PERIOD, [-6.0, -5.0]),
    ):
        with pytest.raises(SimulationError, match=words):
            design.close(stick(design.plant.outputs)).simulate(design.parameters, STICK, reference, samples=5)


def test_an_estimator_of_another_plant_is_named():
    other = kalman_observer(linearised(carts(), CARTS), PERIOD, 1.0, 1.0)
    with pytest.raises(SimulationError, match="kalman_observer for this plant"):
        lqr(upright(), PERIOD, 1.0, 1.0, estimator=other)
