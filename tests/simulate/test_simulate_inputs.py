"""Inputs, histories, grids and everything that a caller can get wrong."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulate_plants import P, exact, record, stiff

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError, SimulationError
from plantfit.models.model import Declared, Delay, Model
from plantfit.simulate import Simulator
from plantfit.simulate.steps.grid import delayed_pieces, merge

import jax


def integrator() -> Model:
    """x' = k * u(t - Td), y = x."""
    return Model(
        name="integrator",
        states={"x": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("k"), Declared("Td", "s")),
        derivative=lambda x, u, p: {"x": p["k"] * u["late"]},
        output=lambda x, u, p: {"y": x["x"]},
        delays=(Delay("late", "u", "Td"),),
    )


def outputs(simulator, p, t, u, **more):
    return np.asarray(simulator.outputs(p, simulator.drive(t, {"u": u}, **more))["y"])


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0, 1.75, 2.0, 3.5, 20.0])
def test_delayed_steps_are_exact_for_an_integrator(delay):
    t = np.arange(0.0, 8.0, 0.5)
    u = np.where(t >= 1.0, 2.0, 0.0)
    y = outputs(Simulator.of(integrator()), {"k": 3.0, "Td": delay}, t, u)
    np.testing.assert_allclose(y, 6.0 * np.maximum(0.0, t - 1.0 - delay), atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0, 3.3])
def test_delayed_ramps_are_exact_for_an_integrator(delay):
    t = np.arange(0.0, 8.0, 0.5)
    y = outputs(Simulator.of(integrator(), hold={"u": "linear"}), {"k": 2.0, "Td": delay}, t, t)
    np.testing.assert_allclose(y, np.maximum(0.0, t - delay) ** 2, atol=1e-12)


@pytest.mark.parametrize(("before", "expected"), [(None, 5.0), (0.0, 0.0), (-2.0, -2.0)])
@pytest.mark.parametrize("hold", ["previous", "linear"])
def test_input_ahead_of_the_record_is_the_history_given(before, expected, hold):
    t, u = np.arange(6.0), np.full(6, 5.0)
    simulator = Simulator.of(integrator(), hold={"u": hold})
    y = outputs(simulator, {"k": 1.0, "Td": 2.0}, t, u, before={} if before is None else {"u": before})
    np.testing.assert_allclose(y, np.where(t <= 2.0, expected * t, 2.0 * expected + 5.0 * (t - 2.0)), atol=1e-12)


@cache
def by_dead_time():
    """Places of the samples and lengths of the steps, outputs, and their derivative by the dead time."""
    t, u = record()
    simulator = Simulator.of(stiff(), substeps=2)
    drive = simulator.drive(t, {"u": u})

    def y(delay):
        return simulator.outputs({**P, "Td": delay}, drive)["y"]

    @jax.jit
    def found(delay):
        steps, (_, _, length) = simulator.steps({**P, "Td": delay}, drive)
        return steps.rank, length, *jax.jvp(y, (delay,), (1.0,))

    return found


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
def test_edges_on_samples_give_steps_of_length_zero_and_finite_derivatives(delay):
    t, _ = record()
    rank, length, y, slope = map(np.asarray, by_dead_time()(delay))
    assert np.any(length == 0.0)
    assert np.all(length >= 0.0)
    assert np.all(np.isfinite(slope))
    np.testing.assert_allclose(y, by_dead_time()(delay + 1e-12)[2], atol=1e-8)
    np.testing.assert_allclose(np.sum(length), t[-1] - t[0])
    assert rank[-1] == len(length)


def test_merged_grid_is_sorted_and_holds_every_sample_and_edge():
    rng = np.random.default_rng(1)
    for _ in range(20):
        t = np.cumsum(rng.uniform(0.1, 1.0, 30))
        knots, delays = (
            (np.sort(rng.choice(t, 6, replace=False)), np.sort(rng.choice(t, 3, replace=False))),
            tuple(rng.uniform(0, 8, 2)),
        )
        steps = merge(t, knots, delays)
        grid = np.r_[np.asarray(steps.start), np.asarray(steps.start)[-1] + np.asarray(steps.length)[-1]]
        wanted = np.sort(np.concatenate([t, *(np.minimum(k + d, t[-1]) for k, d in zip(knots, delays, strict=True))]))
        np.testing.assert_allclose(grid, wanted, atol=1e-12)
        np.testing.assert_allclose(grid[np.asarray(steps.rank)], t, atol=1e-12)
        inside = np.asarray(steps.length) > 0
        middle = (np.asarray(steps.start) + 0.5 * np.asarray(steps.length))[inside]
        for k, d, piece in zip(knots, delays, steps.piece, strict=True):
            np.testing.assert_array_equal(np.asarray(piece)[inside], np.searchsorted(k + d, middle))


@pytest.mark.parametrize("channels", [0, 1, 2])
def test_few_comparisons_and_a_search_give_the_same_grid(channels, monkeypatch):
    rng = np.random.default_rng(channels)
    t = np.cumsum(rng.uniform(0.1, 1.0, 40))
    knots = tuple(np.sort(rng.choice(t, 7, replace=False)) for _ in range(channels))
    for delays in itertools.product((0.0, 0.37, 5.0, 100.0), repeat=channels):  # ties at samples, and beyond the record
        few = merge(t, knots, delays)
        with monkeypatch.context() as searched:
            searched.setattr("plantfit.simulate.steps.grid.FEW", 0)
            many = merge(t, knots, delays)
        assert jax.tree.all(jax.tree.map(lambda a, b: bool(np.array_equal(a, b)), few, many))
        assert np.array_equal(few.sample, np.searchsorted(few.rank, np.arange(len(few.start)), side="right") - 1)


@pytest.mark.parametrize("hold", ["previous", "linear"])
def test_pieces_keep_only_real_changes(hold):
    t = np.arange(10.0)
    pieces = delayed_pieces(t, np.where(t < 5, 1.0, 2.0), hold, 1.0)
    np.testing.assert_array_equal(pieces.knots, [5.0] if hold == "previous" else [4.0, 5.0])


def test_shifting_time_changes_nothing():
    t, u = record(irregular=True)
    simulator = Simulator.of(stiff())
    np.testing.assert_allclose(outputs(simulator, P, t, u), outputs(simulator, P, t + 1000.0, u), atol=1e-9)


def test_more_substeps_come_closer_and_refined_is_the_same_as_asking():
    t, u = record()
    truth = exact(P, t, u)[1]
    errors = [np.max(np.abs(outputs(Simulator.of(stiff(), substeps=m), P, t, u) - truth)) for m in (2, 4, 8, 16)]
    assert all(b < 0.5 * a for a, b in itertools.pairwise(errors))
    np.testing.assert_array_equal(
        outputs(Simulator.of(stiff(), substeps=2).refined(3), P, t, u),
        outputs(Simulator.of(stiff(), substeps=6), P, t, u),
    )


def static() -> Model:
    return Model(
        name="static",
        states={},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("a"), Declared("Td", "s")),
        output=lambda x, u, p: {"y": p["a"] * u["u"] ** 2 + u["late"] + 0.0 * u["t"]},
        delays=(Delay("late", "u", "Td"),),
    )


@pytest.mark.parametrize("hold", ["previous", "linear"])
def test_static_models_need_no_states(hold):
    t = np.arange(10.0)
    u = np.sin(t)
    y = outputs(Simulator.of(static(), hold={"u": hold}), {"a": 3.0, "Td": 2.5}, t, u)
    late = np.interp(t - 2.5, t, u, left=u[0]) if hold == "linear" else u[np.maximum(0, np.floor(t - 2.5).astype(int))]
    np.testing.assert_allclose(y, 3.0 * u**2 + late, atol=1e-12)


def test_initial_states_see_the_first_measured_value():
    model = Model(
        name="still",
        states={"x": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(),
        derivative=lambda x, u, p: {"x": 0.0 * x["x"]},
        output=lambda x, u, p: {"y": x["x"]},
        initial_state=lambda p, u0, y0: {"x": y0["y"] + u0["u"]},
    )
    simulator = Simulator.of(model)
    y = outputs(simulator, {}, np.arange(4.0), np.full(4, 10.0), measured={"y": np.array([np.nan, 7.0, 8.0, 9.0])})
    np.testing.assert_array_equal(y, 17.0)


def test_a_record_of_one_sample_gives_the_initial_state():
    assert outputs(Simulator.of(stiff()), P, np.zeros(1), np.ones(1)) == pytest.approx([P["x20"]])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"stepper": "euler"}, ["'euler'", "rk4"]),
        ({"substeps": 0}, ["substeps = 0"]),
        ({"hold": {"v": "linear"}}, ["'v'", "['u']"]),
        ({"hold": {"u": "cubic"}}, ["'cubic'", "'linear'"]),
    ],
)
def test_wrong_settings_are_named(more, words):
    with pytest.raises(SimulationError) as error:
        Simulator.of(stiff(), **more)
    assert all(w in str(error.value) for w in words)


def test_missing_input_is_named():
    with pytest.raises(SimulationError, match="needs the input 'u'"):
        Simulator.of(stiff()).drive(np.arange(3.0), {})


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_gap_in_an_input_is_placed(bad):
    u = np.array([0.0, 1.0, bad, 1.0])
    with pytest.raises(SimulationError, match=r"'u' is missing at sample 2 \(1 s\)"):
        Simulator.of(stiff()).drive(np.arange(4.0) / 2, {"u": u})


def test_initial_state_that_forgets_a_state_is_named():
    model = integrator()
    forgetful = replace(model, initial_state=lambda p, u0, y0: {})
    with pytest.raises(SimulationError, match="no value for the state 'x'"):
        outputs(Simulator.of(forgetful), {"k": 1.0, "Td": 0.0}, np.arange(3.0), np.ones(3))


def test_derivative_that_forgets_a_state_is_named():
    model = integrator()
    with pytest.raises(ModelError, match=r"derivative\(x, u, p\) returned \[\], without 'x'"):
        Simulator.of(replace(model, derivative=lambda x, u, p: {}))
