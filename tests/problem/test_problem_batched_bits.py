"""What a search relies on: nothing is compiled twice, bad candidates harm nobody, the place in a batch changes no
bit."""

from functools import cache

import numpy as np
import pytest
from problem_batched_plants import Case, points

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Model
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal

import jax


@cache
def problem_of(delays: int) -> Problem:
    return Case((70, 20), delays=delays, dense=True).problem()


@pytest.mark.parametrize("delays", [0, 1])
def test_costs_are_the_same_bits_wherever_a_candidate_stands(delays):
    problem = problem_of(delays)
    zs = points(problem, 64)
    f = np.asarray(problem.costs(zs))
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(64)
        np.testing.assert_array_equal(np.asarray(problem.costs(zs[order])), f[order])
    np.testing.assert_array_equal(np.asarray(problem.costs(np.r_[zs[:1], zs[:63]]))[1:], f[:63])
    assert len(set(f)) == 64


def test_other_numbers_compile_nothing():
    problem = problem_of(0)
    compiled = []
    zs, others = points(problem, 64), points(problem, 64, seed=1)
    problem.costs(zs)
    problem.values_and_gradients(zs[:5])
    assert len(problem.compiled["costs"]._programs) == 1
    jax.monitoring.register_event_duration_secs_listener(lambda event, *_, **__: compiled.append(event))
    try:
        a, b = problem.costs(others), problem.values_and_gradients(others[:5])
        other_scales = problem.with_scales({"y": 2.0}).costs(others)
    finally:
        jax.monitoring.clear_event_listeners()
    assert not [e for e in compiled if "compile" in e or "trace" in e]
    np.testing.assert_allclose(b[0], a[:5], rtol=1e-12)
    np.testing.assert_allclose(other_scales, np.asarray(a) / 4.0, rtol=1e-12)
    assert len(problem.compiled["costs"]._programs) == 1
    assert len(problem.compiled["values_and_gradients"]._programs) == 1


def fragile() -> Problem:
    """x' = a x^2 + (u - x)/T from x = 1: escapes in finite time for a large, divides by 0 at T = 0, by hand at b =
    0."""
    model = Model(
        name="fragile",
        states={"x": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(
            Declared("a", bounds=(-1.0, 400.0)),
            Declared("T", bounds=(0.0, 2.0)),
            Declared("b", bounds=(0.0, 2.0)),
        ),
        derivative=lambda x, u, p: {"x": p["a"] * x["x"] * x["x"] + (u["u"] - x["x"]) / p["T"]},
        output=lambda x, u, p: {"y": x["x"] / p["b"]},
        initial_state=lambda p, u0, y0: {"x": 1.0},
    )
    t = 0.1 * np.arange(30)
    recordings = {
        n: Recording(t[:k], {"u": Signal(np.sin(t[:k])), "y": Signal(np.cos(t[:k]))}, n)
        for n, k in (("long", 30), ("short", 9))
    }
    return Problem(model, recordings, stepper="rk4")


def test_candidates_that_overflow_or_divide_by_zero_cost_infinity_and_leave_the_others_alone():
    problem = fragile()
    zs = np.array(
        [problem.space.cube([a, 0.5 + 0.1 * k, 1.0]) for k, a in enumerate((-0.5, -0.2, -0.9, 0.0, -0.7, -0.1))]
    )
    good = np.asarray(problem.costs(zs))
    assert np.all(np.isfinite(good))
    bad = zs.copy()
    bad[1], bad[3], bad[4] = (
        problem.space.cube([400.0, 1.0, 1.0]),
        problem.space.cube([0.0, 0.0, 1.0]),
        problem.space.cube([0.0, 1.0, 0.0]),
    )
    f = np.asarray(problem.costs(bad))
    np.testing.assert_array_equal(f, np.where([False, True, False, True, True, False], np.inf, good))
    assert np.asarray(problem.costs(bad[1:2]))[0] == np.inf
    _, gradient = problem.values_and_gradients(bad)
    _, unharmed = problem.values_and_gradients(zs)
    np.testing.assert_array_equal(np.asarray(gradient)[[0, 2, 5]], np.asarray(unharmed)[[0, 2, 5]])
