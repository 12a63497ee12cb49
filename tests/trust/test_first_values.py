"""States that begin at measured values: their noise reaches the parameters, and the intervals say so."""

import dataclasses

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.models.extensions import with_extensions
from plantfit.models.library import catalogue as library
from plantfit.models.remade import takes
from plantfit.trust.finish.descent import descent
from plantfit.trust.identify.determined import determined_findings
from plantfit.trust.intervals.first_values import first_value_effects
from plantfit.trust.intervals.linearised import linearise, residual_blocks
from plantfit.trust.intervals.parameter_rows import parameter_rows
from plantfit.trust.verdict.parameters import parameter_sentences

N, NOISE = 300, 0.02
T = np.arange(N) * 0.1
TRUTH = {"K": 2.0, "tau": 2.0, "c": 1.0}
BOUNDS = {"K": (-50.0, 50.0), "tau": (0.05, 200.0), "c": (-50.0, 50.0), "y0": (-50.0, 50.0)}
DECLARED = {n: {"bounds": (0.1, 9.0)} for n in ("K", "tau")}
BLOCKS = np.repeat([0.2, 0.8, 0.35, 0.6], N // 4)


def problem_of(y, u=None, initial="measured"):
    model = library.make("first_order", dead_time=False, initial=initial)
    names = ("K", "tau", "c", *(("y0",) if initial == "free" else ()))
    record = Recording(T, {"u": Signal(np.ones(N) if u is None else u), "y": Signal(y)})
    return Problem(model, record, {n: BOUNDS[n] for n in names}, substeps=2)


def clean(u=None):
    """From rest at y = 1: with u = 1 a step of 2."""
    problem = problem_of(np.ones(N), u)
    return problem.predict(problem.space.vector(TRUTH))["y"]


def answer(problem):
    start = {**TRUTH, "y0": 0.7}
    return descent(
        problem, problem.space.cube(problem.space.vector({n: 1.2 * start[n] for n in problem.space.names}))
    ).z


def test_the_effect_of_a_first_value_is_the_free_response():
    problem = problem_of(clean() + NOISE * np.random.default_rng(0).normal(size=N))
    z = answer(problem)
    tau = float(np.asarray(problem.space.physical(z))[1])
    (column,) = first_value_effects(problem, z, residual_blocks(problem)).noise.T
    noise = np.sqrt(np.sum(np.asarray(problem.residuals(z)) ** 2) / (N - 3))  # of scaled residuals
    np.testing.assert_allclose(column[1:], noise * np.exp(-T[1:] / tau), atol=2e-3 * noise)
    assert column[0] == pytest.approx(0.0, abs=1e-9)  # the residual of the value itself stays zero


def test_there_are_none_where_states_begin_elsewhere():
    y = clean() + NOISE * np.random.default_rng(0).normal(size=N)
    free = problem_of(y, initial="free")
    assert first_value_effects(free, answer(free), residual_blocks(free)).noise.shape == (N, 0)
    rest = equations("x' = (K*u - x)/tau\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters=DECLARED)
    problem = Problem(rest, Recording(T, {"u": Signal(np.ones(N)), "y": Signal(y)}))
    assert first_value_effects(problem, np.array([0.3, 0.3]), residual_blocks(problem)).noise.shape == (N, 0)
    line = equations("y = K*u", inputs=["u"], outputs=["y"], parameters={"K": DECLARED["K"]})
    problem = Problem(line, Recording(T, {"u": Signal(T), "y": Signal(y)}))
    assert first_value_effects(problem, np.array([0.3]), residual_blocks(problem)).noise.shape == (N, 0)


@pytest.mark.thorough
def test_every_recording_has_a_column_of_its_own_and_weights_count():
    y = clean() + NOISE * np.random.default_rng(0).normal(size=N)
    one = problem_of(y)
    record = one.experiments[next(iter(one.experiments))].recording
    short = dataclasses.replace(
        record, t=T[:200], signals={n: Signal(s.values[:200], s.unit) for n, s in record.signals.items()}, name="short"
    )
    both = Problem(
        one.model,
        {"long": dataclasses.replace(record, name="long"), "short": short},
        {n: BOUNDS[n] for n in TRUTH},
        substeps=2,
    )
    columns = first_value_effects(both, answer(both), residual_blocks(both)).noise
    assert columns.shape == (N + 200, 2)
    assert np.all(columns[N:, 0] == 0.0)
    assert np.all(columns[:N, 1] == 0.0)
    assert columns[1, 0] > 0 < columns[N + 1, 1]
    weighed = Problem(
        one.model, {"long": record, "short": short}, {n: BOUNDS[n] for n in TRUTH}, substeps=2, balance="recordings"
    )
    assert weighed.weights is not None
    own = first_value_effects(weighed, answer(both), residual_blocks(weighed)).noise
    by_weight = np.sqrt(weighed.weights["long"] / weighed.weights["short"])
    assert own[1, 0] / own[N + 1, 1] == pytest.approx(by_weight * columns[1, 0] / columns[N + 1, 1], rel=0.02)


def estimates(problem, base, seeds, first=True):
    """(values, standard errors) of tau over records that differ in their noise, with the `first` value noisy or not."""
    found = []
    for seed in range(seeds):
        noise = NOISE * np.random.default_rng(seed).normal(size=N)
        noise[0] *= first
        record = problem.experiments[next(iter(problem.experiments))].recording
        noisy = problem.with_recordings(
            {
                next(iter(problem.experiments)): dataclasses.replace(
                    record, signals={**record.signals, "y": Signal(base + noise)}
                )
            }
        )
        local = linearise(noisy, answer(noisy))
        assert local.linear is not None
        found.append((local.values[1], local.linear.standard_error[1], local.linear.begun[1]))
    return np.array(found).T


@pytest.mark.parametrize(("u", "much"), [(None, True), (BLOCKS, False)])
@pytest.mark.thorough
def test_intervals_hold_the_truth_and_the_factor_is_what_the_first_value_does(u, much):
    base, seeds = clean(u), 120
    problem = problem_of(base, u)
    value, error, factor = estimates(problem, base, seeds)
    held = np.abs(value - TRUTH["tau"]) <= 1.97 * error
    assert 0.90 <= np.mean(held) <= 0.99
    if much:
        assert np.mean(np.abs(value - TRUTH["tau"]) <= 1.97 * error / factor) < 0.85  # what they were without
    calm = estimates(problem, base, seeds, first=False)[0]
    assert np.median(factor) == pytest.approx(np.std(value) / np.std(calm), rel=0.25)


def test_an_unstable_plant_with_a_free_start_is_as_well_known_as_without_the_measured_one():
    """1e-3 rad make 3 rad within the record: over the whole noise differences would leave the tangent, and the start
    not absorb them."""
    model = equations(
        "theta' = omega; omega' = a*sin(theta); y = theta",
        states={"theta": {"unit": "rad", "initial": "y + start"}, "omega": "rad/s"},
        outputs={"y": "rad"},
        parameters={"a": {"unit": "1/s^2", "bounds": (50.0, 80.0)}, "start": {"unit": "rad", "bounds": (-0.1, 0.1)}},
    )
    t = np.arange(0, 1.0, 0.01)
    own = {"a": (50.0, 80.0), "start": (-0.1, 0.1)}
    problem = Problem(model, Recording(t, {"y": Signal(np.full(len(t), 1e-3), "rad")}), own, stepper="rk4", substeps=4)
    y = problem.predict(problem.space.vector({"a": 64.0, "start": 0.0}))["y"]
    y = y + 1e-3 * np.random.default_rng(3).normal(size=len(y))
    problem = problem.with_recordings({next(iter(problem.experiments)): Recording(t, {"y": Signal(y, "rad")})})
    z = descent(problem, problem.space.cube(problem.space.vector({"a": 64.0, "start": 1e-3 - y[0]}))).z
    local = linearise(problem, z)
    assert first_value_effects(problem, z, residual_blocks(problem)).noise.shape[1] == 1
    assert local.linear is not None
    # `start` takes up what the value does: a does not move
    np.testing.assert_allclose(local.linear.begun[:1], 1.0, atol=0.05)


def test_the_sentence_stands_where_it_matters():
    y = clean() + NOISE * np.random.default_rng(1).normal(size=N)
    for initial, said in (("measured", True), ("free", False)):
        problem = problem_of(y, initial=initial)
        z = answer(problem)
        local = linearise(problem, z)
        rows = parameter_rows(problem.space, local)
        determined = determined_findings(problem, local.linear, rows, {})
        assert determined is not None
        findings = {"parameters": rows, "determined": determined.plain()}
        told = [s["sentence"] for s in parameter_sentences(findings) if "begin at the first measured" in s["sentence"]]
        assert bool(told) == said
        if said:
            assert "interval of tau" in told[0]
            assert 'options = { initial = "free" }' in told[0]
            assert "per_recording" not in told[0]
            several = [s["sentence"] for s in parameter_sentences({**findings, "recordings": [{}, {}]})]
            assert any("several recordings need with per_recording = true" in s for s in several)
            assert findings["determined"]["first_values"]["factor"] > 1.5


def test_what_to_write_is_told_of_models_that_take_it():
    first, free = (library.make("first_order", dead_time=False, initial=i) for i in ("measured", "free"))
    motor = library.make("dc_motor")
    own = equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": "y"}}, outputs=["y"], parameters=DECLARED
    )
    assert [takes(m, "initial", "free") for m in (first, free, motor, own)] == [True, False, False, False]
    chamber = library.make("steam_chamber", initial="measured")
    assert not takes(chamber, "initial", "free")  # an option of this name that has no such value


@pytest.mark.parametrize("pieces", [1, 2])
@pytest.mark.parametrize(("kind", "columns"), [("free", False), ("shared", True), ("held", True), ("none", True)])
def test_a_start_that_is_free_in_every_recording_takes_the_noise_of_the_first_value(kind, columns, pieces):
    """A piece of a record begins a free amount above its first measured value, which is one unknown and not two."""
    model = equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": "y"}}, outputs=["y"], parameters=DECLARED
    )
    model = model if kind == "none" else with_extensions(model, {"start": {"x": (-1.0, 1.0)}})
    y = clean() + NOISE * np.random.default_rng(0).normal(size=N)
    u, part = np.ones(N), N // pieces
    records = {}
    for k in range(pieces):
        at = slice(k * part, (k + 1) * part)
        records[f"r{k}"] = Recording(T[at] - T[at][0], {"u": Signal(u[at]), "y": Signal(y[at])}, f"r{k}")
    bounds = (-1.0, 1.0)
    own = {"free": Parameter(bounds, per_recording=True), "shared": Parameter(bounds), "held": 0.0}
    given = {"start_x": own[kind]} if kind in own else {}
    problem = Problem(model, records, {n: BOUNDS[n] for n in ("K", "tau")} | given, substeps=2)
    effects = first_value_effects(problem, np.full(problem.space.dimension, 0.4), residual_blocks(problem))
    shared_alone = kind == "shared" and pieces == 1  # one recording: its value is its own
    assert (effects.noise.shape[1] > 0) is (columns and not shared_alone)
