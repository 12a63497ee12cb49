"""What a problem makes of recordings: units, gaps, parts, offsets, scales, derivatives."""

import numpy as np
import pytest
from problem_motors import MOTOR, line, line_recording, motor_recording

import plantfit.runtime  # noqa: F401
from plantfit.models import dc_motor
from plantfit.models.model import Declared, Model
from plantfit.problem import Experiment, Problem, split
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

import jax.numpy as jnp


def at(problem, **values):
    """The cube point of named values."""
    return problem.space.cube(problem.space.vector(values))


def changed(recording, **signals):
    return Recording(recording.t, {**recording.signals, **signals}, recording.name)


def test_residuals_are_simulated_minus_measured():
    recording = line_recording()
    problem = Problem(line(), recording)
    expected = 1.5 * recording["u"] + 0.5 - recording["y"]
    np.testing.assert_allclose(problem.residuals(at(problem, a=1.5, b=0.5)), expected, atol=1e-12)
    assert float(problem.cost(at(problem, a=1.5, b=0.5))) == pytest.approx(np.mean(expected**2))
    assert problem.costs(at(problem, a=1.5, b=0.5)[None])[0] == pytest.approx(np.mean(expected**2))


def test_signals_are_turned_into_the_units_of_the_model():
    rad, rpm = (Problem(dc_motor(tied=True), motor_recording(unit=u), substeps=2) for u in ("rad/s", "rpm"))
    np.testing.assert_allclose(rad.residuals(at(rad, **MOTOR)), rpm.residuals(at(rpm, **MOTOR)), rtol=1e-9, atol=1e-9)
    assert any("rpm" in line for line in rpm.experiments["motor"].recording.log)
    assert not rad.experiments["motor"].recording.log


def test_missing_samples_of_an_output_are_left_out():
    whole = line_recording()
    y = whole["y"].copy()
    y[[0, 3, 4, 50]] = np.nan
    problem = Problem(line(), changed(whole, y=Signal(y)))
    z = at(problem, a=1.0, b=0.0)
    kept = np.isfinite(y)
    np.testing.assert_allclose(problem.residuals(z), (whole["u"] - whole["y"])[kept], atol=1e-12)


def test_split_keeps_the_end_unseen():
    recording = line_recording(n=80)
    problem = Problem(line(), recording, split=0.7)
    assert len(problem.residuals(at(problem, a=1.0, b=0.0))) == 56
    disturbed = recording["y"].copy()
    disturbed[56:] += 100.0
    other = Problem(line(), changed(recording, y=Signal(disturbed)), split=0.7)
    z = at(problem, a=1.0, b=0.0)
    np.testing.assert_array_equal(problem.residuals(z), other.residuals(z))
    parts = problem.experiments["line"]
    assert not np.any(parts.mask("fit") & parts.mask("validation"))
    assert np.all(parts.mask("fit") | parts.mask("validation"))


def test_skip_leaves_out_the_start_of_every_part():
    experiment = split(line_recording(n=80), 0.5, skip=0.55)
    assert np.flatnonzero(experiment.mask("fit"))[[0, -1]].tolist() == [6, 39]
    assert np.flatnonzero(experiment.mask("validation"))[[0, -1]].tolist() == [46, 79]


def test_validation_recordings_do_not_enter_the_cost():
    one, two = line_recording(seed=0, name="one"), line_recording(seed=1, name="two")
    both = Problem(line(), {"one": one, "two": two}, validate=["two"])
    alone = Problem(line(), one)
    z = at(alone, a=1.0, b=0.0)
    np.testing.assert_array_equal(both.residuals(z), alone.residuals(z))
    np.testing.assert_allclose(both.predict([1.0, 0.5], "two")["y"], two["u"] + 0.5, atol=1e-12)


def test_per_recording_parameters_belong_to_their_recording():
    records = {n: line_recording(seed=i, name=n) for i, n in enumerate("pq")}
    problem = Problem(line(), records, {"b": Parameter((-5, 5), per_recording=True)})
    assert problem.space.names == ("a", "b[p]", "b[q]")
    z = at(problem, **{"a": 1.0, "b[p]": 2.0, "b[q]": -3.0})
    expected = np.concatenate([records[n]["u"] + b - records[n]["y"] for n, b in (("p", 2.0), ("q", -3.0))])
    np.testing.assert_allclose(problem.residuals(z), expected, atol=1e-12)
    _, jacobian = problem.residuals_and_jacobian(z)
    n = len(records["p"])
    assert np.all(jacobian[n:, 1] == 0.0)
    assert np.all(jacobian[:n, 2] == 0.0)


def two_outputs() -> Model:
    return Model(
        name="two",
        states={},
        inputs={"u": None},
        outputs={"y": None, "v": None},
        parameters=(Declared("a", bounds=(-10.0, 10.0)),),
        output=lambda x, u, p: {"y": p["a"] * u["u"], "v": 1000.0 * p["a"] * u["u"]},
    )


def test_outputs_are_scaled_by_their_spread_unless_told():
    recording = line_recording(noise=0.0, b=0.0)
    recording = changed(recording, v=Signal(1000.0 * recording["y"]))
    problem = Problem(two_outputs(), recording)
    r = np.asarray(problem.residuals(at(problem, a=0.0)))
    n = len(recording)
    np.testing.assert_allclose(r[:n], r[n:], rtol=1e-12)
    np.testing.assert_allclose(np.std(r[:n]), 1.0)
    told = Problem(two_outputs(), recording, scales={"y": 0.5, "v": 1.0})
    np.testing.assert_allclose(told.residuals(at(told, a=0.0))[:n], -recording["y"] / 0.5, atol=1e-12)
    again = problem.with_scales({"y": 0.5, "v": 1.0})
    np.testing.assert_allclose(again.residuals(at(again, a=0.0)), told.residuals(at(told, a=0.0)))
    assert problem.scales["v"] == pytest.approx(np.std(recording["v"]))


def test_a_candidate_that_explodes_costs_infinity_and_spares_its_neighbours():
    model = Model(
        name="escape",
        states={"x": None},
        inputs={},
        outputs={"x": None},
        parameters=(Declared("k", bounds=(-5.0, 500.0)),),
        derivative=lambda x, u, p: {"x": p["k"] * x["x"] ** 2},
        output=lambda x, u, p: {"x": x["x"]},
        initial_state=lambda p, u0, y0: {"x": jnp.ones(())},
    )
    recording = Recording(np.linspace(0.0, 50.0, 400), {"x": Signal(np.ones(400))})
    problem = Problem(model, recording, stepper="rk4", substeps=1)
    costs = np.asarray(problem.costs(np.stack([at(problem, k=0.0), at(problem, k=400.0), at(problem, k=-1.0)])))
    assert costs[0] == pytest.approx(0.0, abs=1e-20)
    assert costs[1] == np.inf
    assert np.isfinite(costs[2])


def test_jacobian_and_gradient_are_those_of_the_residuals():
    problem = Problem(dc_motor(tied=True), motor_recording(n=120), substeps=2)
    z = np.clip(at(problem, **MOTOR) + 0.02, 0, 1)
    r, jacobian = problem.residuals_and_jacobian(z)
    cost, gradient = problem.value_and_gradient(z)
    np.testing.assert_allclose(r, problem.residuals(z), rtol=1e-10)
    assert cost == pytest.approx(np.mean(r**2), rel=1e-12)
    np.testing.assert_allclose(gradient, 2.0 * jacobian.T @ r / len(r), rtol=1e-9)
    h = 1e-4
    ends = problem.costs(np.concatenate([z + h * np.eye(len(z)), z - h * np.eye(len(z))]))
    np.testing.assert_allclose(
        gradient, (ends[: len(z)] - ends[len(z) :]) / (2 * h), rtol=1e-3, atol=1e-6 * np.max(np.abs(gradient))
    )


def test_a_fit_part_in_the_middle_simulates_what_came_before():
    recording = line_recording()
    experiment = Experiment(recording, fit=(2.0, 4.0), validate=(4.0, np.inf))
    problem = Problem(line(), experiment)
    inside = (recording.t >= 2.0) & (recording.t < 4.0)
    np.testing.assert_allclose(problem.residuals(at(problem, a=0.0, b=0.0)), -recording["y"][inside], atol=1e-12)


def test_substeps_are_chosen_only_when_the_user_has_not():
    free = choose_substeps(Problem(dc_motor(tied=True), motor_recording(n=120)))
    simulator = free.predictor.simulator
    assert simulator is not None
    finer = free.with_simulator(simulator.refined(8))
    z = at(free, **MOTOR)
    step_error = np.asarray(free.residuals(z) - finer.residuals(z))
    assert np.sqrt(np.mean(step_error**2)) < 0.02 * np.std(free.experiments["motor"].recording["w"])
    told = Problem(dc_motor(tied=True), motor_recording(n=120), substeps=1)
    assert choose_substeps(told) is told
