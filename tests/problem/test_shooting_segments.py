"""Cutting a record changes nothing: segments begun at the true states join to the whole simulation."""

import numpy as np
import pytest
from shooting_plants import LAG, PENDULUM, balanced, lag, lag_recording, oscillation

from plantfit.errors import SearchError, SimulationError
from plantfit.models.model import Declared, Model
from plantfit.models.parts.switching import StateDelay
from plantfit.problem import Experiment, Problem
from plantfit.problem.shooting.segments import cut
from plantfit.problem.shooting.start import Shooting
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

import jax


def lag_problem(**options) -> Problem:
    return Problem(lag(), lag_recording(irregular=options.pop("irregular", False)), substeps=2, **options)


def whole(problem: Problem, z: np.ndarray):
    """Cube point's states (N, n) over the first record by one simulation."""
    name, drive = next(iter(problem.data["drive"].items()))
    p = problem.space.tree(problem.space.physical(z), name)
    states = jax.jit(problem.predictor.stepping().states)(p, drive)
    return np.stack([np.asarray(x) for x in states], axis=-1), np.asarray(drive.t)


def begun_at_the_whole(shooting: Shooting, z: np.ndarray):
    """Rows and final states of the segments when they start where one simulation passes, its states, and where they
    start."""
    x, t = whole(shooting.problem, z)
    pieces = shooting.cut
    first = np.searchsorted(t, np.asarray(pieces.segments.drive.t)[:, 0])
    rows, end, _ = (np.asarray(a) for a in shooting.functions["linearised"](z[pieces.local], x[first], pieces.segments))
    return rows, end, x, first


@pytest.mark.parametrize(
    "options",
    [pytest.param({}, marks=pytest.mark.slow), {"irregular": True}, {"hold": {"u": "linear"}}, {"before": {"u": 3.0}}],
)
@pytest.mark.further(1)
def test_segments_of_a_late_input_join_to_the_whole_simulation(options):
    problem = lag_problem(**options)
    shooting = Shooting.of(problem, segments=12)
    for delay in (0.33, 0.3, 0.0, 1.0):
        z = problem.space.cube([LAG["K"], LAG["T"], delay])
        rows, end, x, first = begun_at_the_whole(shooting, z)
        np.testing.assert_allclose(end[:-1], x[first[1:]], rtol=1e-10, atol=1e-12)
        assert np.sum(rows[:, :, -1] ** 2) * shooting.unit**2 == pytest.approx(float(problem.cost(z)), rel=1e-9)


def test_two_states_join_as_well():
    problem = balanced(n=150)
    shooting, z = Shooting.of(problem, segments=7), problem.space.cube(list(PENDULUM.values()))
    rows, end, x, first = begun_at_the_whole(shooting, z)
    np.testing.assert_allclose(end[:-1], x[first[1:]], rtol=1e-8, atol=1e-10)
    assert np.sum(rows[:, :, -1] ** 2) * shooting.unit**2 == pytest.approx(float(problem.cost(z)), rel=1e-8)


def test_derivatives_equal_central_differences():
    problem = lag_problem(irregular=True)
    shooting = Shooting.of(problem, segments=6)
    pieces, n = shooting.cut, 1
    rng = np.random.default_rng(0)
    z, s = problem.space.cube([1.7, 0.5, 0.29]), rng.normal(size=(6, n))

    def at(z, s):
        return [np.asarray(a) for a in shooting.functions["linearised"](z[pieces.local], s, pieces.segments)]

    def half_squares(z, s):
        return 0.5 * np.sum(at(z, s)[0][:, :, -1] ** 2, axis=1)

    rows, _, by = at(z, s)
    # the triangle keeps the gradient of half the sum of squares
    gradient = np.einsum("lkv,lk->lv", rows[:, :, :-1], rows[:, :, -1])
    for j in range(4):
        dz, ds = (1e-6 * np.eye(3)[j], 0.0) if j < 3 else (np.zeros(3), 1e-6)
        up, down = (z + dz, s + ds), (z - dz, s - ds)
        np.testing.assert_allclose((at(*up)[1] - at(*down)[1])[..., 0] / 2e-6, by[:, 0, j], rtol=2e-5, atol=1e-7)
        np.testing.assert_allclose(
            (half_squares(*up) - half_squares(*down)) / 2e-6, gradient[:, j], rtol=2e-5, atol=1e-8
        )


def test_every_scored_sample_is_scored_once():
    recording = lag_recording()
    y = recording["y"].copy()
    y[[0, 30, 31, 60, 299]] = np.nan
    holed = Recording(recording.t, {**recording.signals, "y": Signal(y)})
    problem = Problem(lag(), Experiment(holed, fit=(0.0, 11.0), validate=(11.0, 99.0), skip=1.2))
    segments = cut(problem, segments=9).segments
    scored, t = np.asarray(segments.scored[0]), np.asarray(segments.drive.t)
    want = recording.t[problem.data["index"][problem.space.recordings[0]]["y"]]
    np.testing.assert_array_equal(np.sort(t[scored]), want)
    np.testing.assert_array_equal(np.asarray(segments.measured[0])[scored], y[np.searchsorted(recording.t, t[scored])])


def test_only_the_knots_that_can_reach_a_segment_are_carried():
    problem = lag_problem()
    knots = cut(problem, segments=30).segments.drive.delayed[0].knots
    # half a second of segment, a second of delay, an edge every half second
    assert knots.shape[1] <= (0.5 + 1.0) / 0.5 + 2


def test_records_of_different_length_get_segments_of_one_length_and_their_own_coordinates():
    records = {"long": lag_recording(n=300), "short": lag_recording(n=100, seed=1)}
    problem = Problem(lag(), records, {"K": Parameter((0.2, 5.0), per_recording=True)})
    pieces = cut(problem, segments=9)
    assert np.bincount(pieces.record).tolist() == [9, 3]
    names = [{problem.space.names[i] for i in row} for row in pieces.local]
    assert names[0] == {"K[long]", "T", "Td"}
    assert names[-1] == {"K[short]", "T", "Td"}
    assert np.flatnonzero(pieces.segments.first).tolist() == [0, 9]
    seconds = cut(problem, length=14.95 / 9)
    assert np.array_equal(seconds.record, pieces.record)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "either segments"),
        ({"segments": 3, "length": 1.0}, "either segments"),
        ({"segments": 0}, "segments = 0"),
        ({"segments": 2000}, "1501 samples"),
        ({"length": -1.0}, "length = -1"),
        ({"length": np.nan}, "length = nan"),
        ({"length": 1e-6}, "between two samples"),
    ],
)
def test_bad_segments_are_named(settings, words):
    with pytest.raises(SearchError, match=words):
        Shooting.of(oscillation(), **settings)


@pytest.mark.parametrize(
    ("z", "settings", "words"),
    [
        (np.zeros(2), {}, "3 finite numbers"),
        (np.array([0.1, np.nan, 0.2]), {}, "3 finite numbers"),
        (np.zeros(3), {"rounds": 0}, "rounds = 0"),
        (np.zeros(3), {"weights": ()}, "weights"),
        (np.zeros(3), {"weights": (1.0, 0.1)}, "grow"),
        (np.zeros(3), {"weights": (0.0, 1.0)}, "positive"),
    ],
)
def test_bad_settings_are_named(z, settings, words):
    with pytest.raises(SearchError, match=words):
        Shooting.of(oscillation(), segments=5).solve(z, **settings)


def test_late_states_are_refused():
    late = Model(
        "late", {"x": None}, {}, {"y": None}, (Declared("k", None, (0.1, 1.0)), Declared("T", "s", (0.5, 1.0))),
        lambda x, u, p: {"y": x["x"]},
        derivative=lambda x, u, p: {"x": -p["k"] * u["before"]},
        state_delays=(StateDelay("before", "x", "T"),),
    )  # fmt: skip
    t = 0.1 * np.arange(20)
    with pytest.raises(SimulationError, match="late states"):
        Shooting.of(Problem(late, Recording(t, {"y": Signal(t)})), segments=2)


def test_a_steady_record_is_refused():
    run = lag_recording(n=50)
    points = Recording(np.arange(4.0), {"u": Signal(np.arange(4.0)), "y": Signal(2.0 * np.arange(4.0))})
    problem = Problem(lag(), {"run": run, "points": Experiment(points, steady=True)})
    with pytest.raises(SimulationError, match="'points' is steady"):
        Shooting.of(problem, segments=2)


def test_a_model_without_states_is_refused():
    line = Model(
        "line", {}, {"u": None}, {"y": None}, (Declared("a", None, (0.0, 1.0)),), lambda x, u, p: {"y": p["a"] * u["u"]}
    )
    t = np.arange(5.0)
    with pytest.raises(SimulationError, match="no states"):
        Shooting.of(Problem(line, Recording(t, {"u": Signal(t), "y": Signal(t)})), segments=2)
