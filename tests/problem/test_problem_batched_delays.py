"""Derivatives by a dead time and by the entries of a table, against central differences of a tight cost.

Where an edge falls onto a sample, or nearly, the derivative of a stepped cost jumps: it is that of whole steps on one
side and of steps of length 0 on the other. With one edge the jump is small; with many its mean is right before its
sides are.
"""

from functools import cache

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.models.model import Declared, Delay, Model
from plantfit.models.parts.tables import lookup
from plantfit.problem import Problem
from plantfit.problem.accuracy.steps import choose_substeps
from plantfit.problem.evaluate.batched import BatchedRecords
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.check.tight import follow
from plantfit.simulate.simulator import Simulator

import jax

QUICK = {"xla_backend_optimization_level": 0}  # these programs run a few times: most of the time is their compilation
ROWS = 20  # candidates in every call, so that it is compiled once
DT = 1 / 16  # every time is an exact binary number
T = DT * np.arange(130)
TARGET = 0.4 * np.sin(1.3 * T)
NODES = (-1.03, -0.27, 0.36, 0.97)
GAINS = {
    "step": np.array([-0.9, -0.3, 0.7, 1.2]),
    "held": np.array([-0.9, -0.3, 0.7, 1.2]),
    "interpolated": 1.1
    * np.array(NODES),  # one line: an input that crosses a kink inside a step leaves only first order
}
EDGE = T[63]  # where the first chunk ends
ONE_SIDED = {"step": 0.02, "held": 0.1, "interpolated": 0.03}  # shares of the largest slope, at steps of T1 / 6
DELAYS = {
    "lower bound": 0.0,
    "on the grid": 0.5,
    "off the grid": 0.53,
    "edge on a chunk's end": EDGE - T[50],
    "upper bound": 1.0,
}


def plant() -> Model:
    """y = x2 follows x1 (T2 = 1 s), which follows k(u(t - Td)) (T1 = 0.4 s) and is slowed by a cubic."""

    def derivative(x, u, p):
        return {"x1": (lookup(p["k"], NODES, u["late"]) - x["x1"] - 0.5 * x["x1"] ** 3) / 0.4, "x2": x["x1"] - x["x2"]}

    return Model(
        name="late",
        states={"x1": None, "x2": None},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("Td", "s", (0.0, 1.0)), Declared("k", bounds=(-2.0, 2.0), shape=(4,))),
        derivative=derivative,
        output=lambda x, u, p: {"y": x["x2"]},
        initial_state=lambda p, u0, y0: {"x1": 0.0, "x2": 0.0},
        delays=(Delay("late", "u", "Td"),),
    )


def signal(kind: str) -> np.ndarray:
    """One step at sample 50, a new value every five samples, or straight lines between these."""
    nodes = np.random.default_rng(4).integers(-12, 13, 27) * 5 / 64
    if kind == "step":
        return np.where(np.arange(130) < 50, -0.5, 0.75)
    return np.repeat(nodes, 5)[:130] if kind == "held" else np.interp(np.arange(130), 5 * np.arange(27), nodes)


@cache
def problem_of(kind: str) -> Problem:
    hold = {"u": "linear" if kind == "interpolated" else "previous"}
    recording = Recording(T, {"u": Signal(signal(kind)), "y": Signal(TARGET)})
    return Problem(plant(), recording, hold=hold, substeps=1)


def cubes(kind: str, delays, gains=None) -> np.ndarray:
    gains = GAINS[kind] if gains is None else gains
    return problem_of(kind).space.cube([[d, *gains] for d in delays])


@cache
def compiled(kind: str, substeps: int, stepper: str, function: str):
    problem = problem_of(kind)
    batched, own = problem.evaluator, problem.predictor.stepping()
    assert isinstance(batched, BatchedRecords)
    assert batched.rows.size == 64
    other = batched.with_simulator(Simulator(own.vector, stepper, substeps, own.interpolated))
    return jax.jit(getattr(other, function), compiler_options=QUICK)


def gradients(kind: str, substeps: int, delays) -> np.ndarray:
    """d cost/d(Td, k) (n, 5) in the units of the parameters."""
    space = problem_of(kind).space
    return costs_and_gradients(kind, substeps, delays)[1] / (space.upper - space.lower)


def costs_and_gradients(kind: str, substeps: int, delays):
    zs = cubes(kind, delays)
    f, g = compiled(kind, substeps, "exponential", "values_and_gradients")(
        np.resize(zs, (ROWS, 5)), problem_of(kind).arguments
    )
    return np.asarray(f)[: len(zs)], np.asarray(g)[: len(zs)]


def tight(kind: str, zs) -> np.ndarray:
    """Costs (n,) by another method and steps of 4 ms; one of the tests holds them against Radau."""
    return np.asarray(compiled(kind, 16, "rk4", "costs")(np.resize(zs, (ROWS, 5)), problem_of(kind).arguments))[
        : len(zs)
    ]


def tight_slopes(kind: str) -> np.ndarray:
    """d cost/d Td of the tight cost at DELAYS; from one side where a negative dead time would be needed."""
    h = 1e-4
    f = tight(
        kind, cubes(kind, [a for d in DELAYS.values() for a in ((0.0, h, 2 * h) if d == 0.0 else (d - h, d, d + h))])
    ).reshape(-1, 3)
    return np.where([d == 0.0 for d in DELAYS.values()], f @ [-1.5, 2.0, -0.5], f @ [-0.5, 0.0, 0.5]) / h


@pytest.mark.parametrize("kind", GAINS)
def test_the_tight_cost_is_that_of_the_tight_solver(kind):
    delay, problem = 0.53, problem_of(kind)
    p = {"Td": delay, "k": GAINS[kind]}
    states = follow(problem.predictor.stepping(), p, problem.data["drive"]["recording"], rtol=1e-10, atol=1e-12).states
    assert tight(kind, cubes(kind, [delay, 0.2]))[0] == pytest.approx(np.mean((states[1] - TARGET) ** 2), rel=1e-7)


@pytest.mark.parametrize("kind", [pytest.param("step", marks=pytest.mark.slow), "held", "interpolated"])
@pytest.mark.thorough
def test_slope_by_dead_time_is_that_of_a_tight_cost(kind):
    expected, places = tight_slopes(kind), np.array(list(DELAYS.values()))
    scale = np.max(np.abs(gradients(kind, 4, np.linspace(0.0, 1.0, 20))[:, 0]))
    sides = {}
    for substeps, small in ((1, 0.01), (4, 0.001)):
        at, before = (
            (gradients(kind, substeps, d)[:, 0] - expected) / scale for d in (places, np.maximum(places - 1e-9, 0.0))
        )
        print(f"{kind}, {substeps} substeps: at {np.round(at, 5)}, just before {np.round(before, 5)} of {scale:.3g}")
        assert abs(at[2]) < small  # off the grid
        assert np.all(np.abs(at + before)[1:] / 2 < (1.5 if kind == "held" else 1.0) * small)
        sides[substeps] = np.max(np.abs([at, before]))
    assert sides[1] < ONE_SIDED[kind]
    assert sides[4] < sides[1] / 12  # second order


@pytest.mark.parametrize("kind", [pytest.param("step", marks=pytest.mark.slow), "held", "interpolated"])
@pytest.mark.thorough
def test_slope_by_dead_time_at_the_default_step_on_samples_and_bounds(kind):
    """Within 1 % at the default step, 0.1 % after two halvings."""
    hold = {"u": "linear" if kind == "interpolated" else "previous"}
    free = Problem(plant(), Recording(T, {"u": Signal(signal(kind)), "y": Signal(TARGET)}), hold=hold)
    chosen = choose_substeps(free).predictor.stepping().substeps
    expected, places = tight_slopes(kind), np.array(list(DELAYS.values()))
    scale = np.max(np.abs(gradients(kind, 4, np.linspace(0.0, 1.0, 20))[:, 0]))
    for substeps, small in ((chosen, 0.01), (4 * chosen, 0.001)):
        for d in (places, np.maximum(places - 1e-9, 0.0)):
            error = np.abs(gradients(kind, substeps, d)[:, 0] - expected) / scale
            print(f"{kind}, {substeps} substeps: {np.round(error, 5)}")
            assert np.max(error) < small


@pytest.mark.parametrize("kind", GAINS)
@pytest.mark.thorough
def test_slope_by_table_entries_is_that_of_a_tight_cost(kind):
    h, delays = 1e-3, (0.53, 1.0)
    for i, delay in enumerate(delays):
        moved = [GAINS[kind] + s * h * e for e in np.eye(4) for s in (1.0, -1.0)]
        f = tight(kind, np.concatenate([cubes(kind, [delay], gains) for gains in moved])).reshape(4, 2)
        expected = (f[:, 0] - f[:, 1]) / (2 * h)
        # an entry bends the table, and a smooth input crosses the bend inside a step
        for substeps, small in ((1, 0.05), (4, 0.005)) if kind == "interpolated" else ((1, 0.01), (4, 0.001)):
            error = np.max(np.abs(gradients(kind, substeps, delays)[i, 1:] - expected)) / np.max(np.abs(expected))
            print(f"{kind}, Td = {delay}, {substeps} substeps: {error:.1e}")
            assert error < small


@pytest.mark.parametrize("kind", GAINS)
def test_cost_has_no_jump_where_an_edge_crosses_a_sample_or_the_end_of_a_chunk(kind):
    for centre in (DELAYS["on the grid"], DELAYS["edge on a chunk's end"]):
        f, _ = costs_and_gradients(kind, 1, [centre - 1e-10, centre, centre + 1e-10])
        np.testing.assert_allclose(f, f[1], atol=1e-9)
