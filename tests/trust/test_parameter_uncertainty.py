"""Shared errors carried to parameters: closed forms, refits, and how often the truth lies inside."""

import dataclasses

import numpy as np
import pytest

import plantfit as pf
from plantfit.errors import SpaceError
from plantfit.models.library.process import first_order
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.rig.steam_chamber import SteamChamberRig, smooth_truth
from plantfit.trust.finish.refit import refit
from plantfit.trust.stated_errors.parameter_uncertainty import SharedError, propagate, propagate_by_monte_carlo
from plantfit.trust.stated_errors.uncertainty_budget import type_b

T = np.arange(300) * 0.1
TRUTH = {"K": 2.0, "tau": 1.5, "L": 0.73}
STEP = "step"


def line(seed: int, offset: float = 0.0, gain: float = 0.0) -> Problem:
    """y = a + b u, a = 1, b = 2, with errors of the sensor of y and noise of 0.05."""
    model = pf.equations(
        "y = a + b*u",
        inputs={"u": "1"},
        outputs={"y": "V"},
        parameters={"a": {"bounds": [-9, 9]}, "b": {"bounds": [-9, 9]}},
    )
    u = np.sin(T)
    y = (1.0 + 2.0 * u) * (1.0 + gain) + offset + 0.05 * np.random.default_rng(seed).standard_normal(len(T))
    return Problem(model, Recording(T, {"u": Signal(u, "1"), "y": Signal(y, "V")}, STEP))


def process(noise: float = 0.01) -> Problem:
    y = TRUTH["K"] * -np.expm1(-np.maximum(T - TRUTH["L"], 0.0) / TRUTH["tau"]) + noise * np.random.default_rng(
        1
    ).standard_normal(len(T))
    record = Recording(T, {"u": Signal(np.ones(len(T))), "y": Signal(np.r_[0.0, y[1:]])}, STEP)
    box = {"K": (0.5, 5.0), "tau": (0.2, 6.0), "L": (0.0, 3.0)}
    return Problem(
        first_order(offset=False), Experiment(record, fit=(0.05, np.inf), before={"u": 0.0}), box, substeps=1
    )


def fitted(problem: Problem) -> np.ndarray:
    d = problem.space.dimension
    return refit(problem, np.full(d, 0.4), np.ones(d, bool), 1e-10)[0]


@pytest.fixture(scope="module")
def step() -> tuple[Problem, np.ndarray]:
    problem = process()
    return problem, fitted(problem)


def test_offset_and_gain_of_a_straight_line_in_closed_form():
    problem = line(0)
    z = fitted(problem)
    a, b = np.asarray(problem.space.physical(z))
    found = propagate(
        problem,
        z,
        [SharedError(type_b("zero", 0.3, "V"), "offset", "y"), SharedError(type_b("span", 0.02), "gain", "y")],
    )
    u = np.array([0.3, 0.02]) / np.sqrt(3)
    assert found.systematic["zero"] == pytest.approx([u[0], 0.0], abs=1e-6)
    assert found.systematic["span"] == pytest.approx([abs(a) * u[1], abs(b) * u[1]], rel=1e-3)
    assert found.combined == pytest.approx(
        np.sqrt(found.random**2 + found.systematic["zero"] ** 2 + found.systematic["span"] ** 2)
    )


def test_a_slow_clock_makes_every_time_long(step):
    problem, z = step
    found = propagate(problem, z, [SharedError(type_b("clock", 1e-3), "clock")])
    values = found.values
    assert found.systematic["clock"][1:] == pytest.approx(values[1:] * 1e-3 / np.sqrt(3), rel=0.02)  # tau and L
    assert found.systematic["clock"][0] < 1e-5  # K


def test_zero_and_full_scale_are_an_offset_and_a_gain(step):
    problem, z = step
    y = problem.experiments[STEP].recording
    source = type_b("card", 0.1)
    zero, full = SharedError(source, "zero", "y", 4.0), SharedError(source, "full scale", "y", 4.0)
    both = full.corrected(zero.corrected(y, 0.05), 0.05)
    assert both["y"] == pytest.approx(y["y"] - 0.05, abs=1e-3)  # together they are an offset, to first order
    found = propagate(problem, z, [full])
    assert found.systematic["card"][0] == pytest.approx(found.values[0] * 0.1 / np.sqrt(3) / 4.0, rel=1e-3)


def test_an_assumed_constant_moves_the_rest_as_refits_do(step):
    problem, z = step
    source = type_b("K from a data sheet", 0.05)
    found = propagate(problem, z, [SharedError(source, "constant", "K")])
    ends = []
    for sign in (1.0, -1.0):
        moved = z.copy()
        moved[0] += sign * source.standard / 4.5
        ends.append(np.asarray(problem.space.physical(refit(problem, moved, np.array([False, True, True]), 1e-10)[0])))
    assert found.systematic["K from a data sheet"][1:] == pytest.approx(np.abs(ends[0] - ends[1])[1:] / 2, rel=0.03)
    assert found.systematic["K from a data sheet"][0] == 0.0
    assert found.random[1] < propagate(problem, z, []).random[1] * 1.001


def test_monte_carlo_agrees_with_the_linear_propagation(step):
    problem, z = step
    errors = [SharedError(type_b("gain", 0.03), "gain", "y"), SharedError(type_b("clock", 0.02), "clock")]
    linear, drawn = propagate(problem, z, errors), propagate_by_monte_carlo(problem, z, errors, draws=150, seed=2)
    assert drawn.combined == pytest.approx(linear.combined, rel=0.2)
    assert np.all(drawn.high - drawn.low < 1.1 * (linear.high - linear.low))  # even errors have short tails
    assert drawn.draws is not None
    again = propagate_by_monte_carlo(problem, z, errors, draws=3, seed=2)
    np.testing.assert_array_equal(again.draws, propagate_by_monte_carlo(problem, z, errors, draws=3, seed=2).draws)


def test_other_recordings_are_fitted_without_compiling_anew(step):
    problem, z = step
    record = problem.experiments[STEP].recording
    late = problem.with_recordings({STEP: Recording(record.t * 1.001, record.signals, STEP)})
    assert late.compiled["residuals"] is problem.compiled["residuals"]
    fresh = Problem(
        first_order(offset=False), dataclasses.replace(problem.experiments[STEP],
                                                       recording=late.experiments[STEP].recording),
        {"K": (0.5, 5.0), "tau": (0.2, 6.0), "L": (0.0, 3.0)}, substeps=1,
    )  # fmt: skip
    np.testing.assert_allclose(late.residuals(z), fresh.residuals(z), atol=1e-12)
    assert not np.allclose(late.residuals(z), problem.residuals(z), atol=1e-6)
    untouched = process()
    untouched.with_recordings(
        {STEP: Recording(record.t, {**record.signals, "y": Signal(0.0 * record.t)}, STEP)}
    ).residuals(z)
    np.testing.assert_array_equal(untouched.residuals(z), problem.residuals(z))


def test_a_constant_must_be_a_parameter(step):
    with pytest.raises(SpaceError, match="The constant 'g' is no single number of the problem"):
        propagate(step[0], step[1], [SharedError(type_b("g", 0.01), "constant", "g")])


def test_total_intervals_of_a_line_hold_what_they_promise():
    sources = type_b("zero", 0.1, "V"), type_b("span", 0.02)
    errors = [SharedError(sources[0], "offset", "y"), SharedError(sources[1], "gain", "y")]
    problem, inside, alone = line(0), [], []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        offset, gain = (float(s.draw(rng, 1)[0]) for s in sources)
        problem = problem.with_recordings({STEP: line(seed, offset, gain).experiments[STEP].recording})
        found = propagate(problem, fitted(problem), errors)
        off = np.abs(found.values - [1.0, 2.0])
        inside.append(off <= found.high - found.values)
        alone.append(off <= 1.96 * found.random)
    assert np.all(np.mean(inside, axis=0) >= 0.93)
    assert np.all(np.mean(alone, axis=0) < 0.5)  # the noise alone promises far too much


def constant_truth(opening: float) -> dict:
    p = smooth_truth(opening)
    return {n: np.full(10, np.mean(p[n])) for n in ("k", "A1", "A2")} | {"Td": p["Td"]}


@pytest.mark.slow
def test_total_intervals_of_steam_parameters_hold_what_they_promise():
    from plantfit.cases.steam.problems import static_problem

    for opening, noise in ((100.0, 0.05), (40.0, 0.01)):  # records whose answers lie inside the bounds
        rig = SteamChamberRig(truth=constant_truth, noise=noise)
        # of a zeroed span
        sources = [type_b(n, 2 * limit / 100, shape="triangular") for n, limit in rig.error_limits.items()]
        errors = [SharedError(s, "gain", "y") for s in sources]
        run = rig.record(opening, 0)
        name, p = run.recording.name, run.truth["parameters"]
        problem = static_problem({name: run.recording})
        truth = np.array([p["k"][0], p["A1"][0], p["A2"][0], p["Td"]])
        start, inside, alone = problem.space.start, [], []  # the paper's, not the truth
        assert start is not None
        for seed in range(200):
            problem = problem.with_recordings({name: rig.record(opening, seed).recording})
            found = propagate(problem, refit(problem, start, np.ones(4, bool), 1e-9)[0], errors)
            inside.append((found.low <= truth) & (truth <= found.high))
            alone.append(np.abs(found.values - truth) <= 1.96 * found.random)
        assert np.all(np.mean(inside, axis=0) >= 0.92), np.mean(inside, axis=0)
        assert np.mean(alone, axis=0)[0] < 0.2  # the gain: its noise is a tenth of what the instruments may err


@pytest.mark.parametrize("draws", [None, 20])
def test_a_value_that_is_pressed_on_a_bound_has_no_interval_and_one_inside_has(draws):
    """a = 1 is pressed on its bound 1.2; nothing is known of it to first order, which is not that it is exact."""
    problem = line(0)
    pressed = Problem(problem.model, problem.experiments, {"a": (1.2, 9.0)})
    error = [SharedError(type_b("zero", 0.3, "V"), "offset", "y")]
    for own, known in ((pressed, False), (problem, True)):
        z = fitted(own)
        found = propagate(own, z, error) if draws is None else propagate_by_monte_carlo(own, z, error, draws)
        for of in (found.random, found.combined, found.systematic["zero"], found.low, found.high):
            assert np.isfinite(of[0]) == known
            assert np.isfinite(of[1])
