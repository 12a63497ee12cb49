"""A disturbance that wanders is told from errors of the model, and the parameters beside it are those of the plant."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.diagnosis import PLANTS, write

from plantfit import Problem, Recording, Signal, fit
from plantfit.spec import load
from plantfit.trust.diagnosis import diagnose, diagnosis_record
from plantfit.trust.validate.wandering import Left, usable, wandering, whitened


def disturbed_problem(place, plant, fault, seed, size=1.0):
    """A record with a random walk on the output, of steps of `size` times the noise, which is 1 % of the output's
    spread."""
    problem = load(write(PLANTS[plant], fault, 0.01, seed, place)).problem
    (name, e), (output,) = next(iter(problem.experiments.items())), problem.outputs
    y = e.recording[output]
    walk = size * 0.01 * np.std(y) * np.cumsum(np.random.default_rng(1000 + seed).standard_normal(len(y)))
    signals = {**e.recording.signals, output: Signal(y + walk, e.recording.signals[output].unit)}
    return problem.with_recordings({name: Recording(e.recording.t, signals, name)}), 0.01 * float(np.std(y))


@pytest.mark.parametrize("plant", ["first", *(pytest.param(p, marks=pytest.mark.slow) for p in ("second", "tanks"))])
@pytest.mark.thorough
def test_parameters_beside_a_disturbance_are_those_of_the_plant(tmp_path, plant):
    told, errors, least_squares, held = 0, [], [], []
    for seed in range(3):
        problem, noise = disturbed_problem(tmp_path, plant, "clean", seed)
        answer = fit(problem, budget=1500)
        found = diagnose(answer.problem, answer.best.x, rounds=1).disturbed
        if found is None:
            continue
        told += 1
        assert found.additions == ()
        assert found.walk.steps == pytest.approx(noise, rel=0.3)
        assert found.walk.noise == pytest.approx(noise, rel=0.3)
        for name, truth in PLANTS[plant].truth.items():
            value, error = found.values[name]
            errors.append(value / truth - 1.0)
            least_squares.append(answer.values[name] / truth - 1.0)
            held.append(abs(value - truth) <= 3.0 * error)
    assert told >= 2
    assert np.mean(np.square(errors)) < 0.8 * np.mean(np.square(least_squares))
    assert np.mean(held) >= 0.9


@pytest.mark.parametrize(
    "fault", ["dead_time", "lag", "saturation", "backlash", "start", "change K with u", "change tau with t"]
)
@pytest.mark.thorough
def test_an_error_of_the_model_is_not_called_a_disturbance(tmp_path, fault):
    """Nor is it where the addition is not tried at all: the residual follows the input."""
    for seed in (1, 2):
        problem = load(write(PLANTS["first"], fault, 0.01, seed, tmp_path)).problem
        answer = fit(problem, budget=1500)
        assert diagnose(answer.problem, answer.best.x, rounds=1).disturbed is None
        z, data = answer.best.x, answer.problem.arguments
        jacobian = np.asarray(answer.problem.compiled["residuals_and_jacobian"](z, data)[1])
        (name, e), (output,) = next(iter(answer.problem.experiments.items())), answer.problem.outputs
        part = e.mask("fit")
        left = usable([Left(answer.residuals[name][output][part], jacobian, {"u": e.recording["u"][part]})])
        assert wandering(left, whitened(left)) is None


@pytest.mark.slow
def test_dry_friction_is_found_beside_a_disturbance(tmp_path):
    problem, _ = disturbed_problem(tmp_path, "second", "coulomb", 7)
    answer = fit(problem, budget=1500)
    d = diagnose(answer.problem, answer.best.x)
    assert d.end.additions[0].kind == "coulomb"
    assert d.disturbed is not None
    assert d.disturbed.additions == d.end.additions
    for name, truth in PLANTS["second"].truth.items():
        value, error = d.disturbed.values[name]
        assert abs(value - truth) <= 4.0 * error, name
    record = diagnosis_record(d)
    said = record["verdict"][-1]["sentence"]
    assert said.startswith("What is left of y wanders by itself, by about 0.0")
    assert "it follows no input: something that is not measured acts on y. With that allowed for m = 0.4" in said
    assert {"m", "b", "k", "coulomb_v"} <= {v["name"] for v in record["wandering"]["values"]}
    assert not any("something else is missing" in s["sentence"] for s in record["verdict"])


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_dry_friction_that_a_disturbance_hides_is_found_on_the_innovations(tmp_path, seed):
    """Of the residuals themselves it explains no more than chance might; it is found where both are there."""
    problem, _ = disturbed_problem(tmp_path, "second", "coulomb", seed)
    answer = fit(problem, budget=1500)
    d = diagnose(answer.problem, answer.best.x, rounds=1)
    assert d.end.additions[0].kind == "coulomb"
    assert d.disturbed is not None
    for name, truth in PLANTS["second"].truth.items():
        value, error = d.disturbed.values[name]
        assert abs(value - truth) <= 4.0 * error, name
        assert abs(answer.values["b"] - PLANTS["second"].truth["b"]) > 0.2


@pytest.mark.thorough
def test_a_dead_time_moves_beside_a_disturbance(tmp_path):
    problem, _ = disturbed_problem(tmp_path, "first", "dead_time", 4)
    answer = fit(problem, budget=1500)
    d = diagnose(answer.problem, answer.best.x, rounds=1)
    assert d.disturbed is not None
    truth = {**PLANTS["first"].truth, "dead_time_u": PLANTS["first"].faults["dead_time"]}
    for name, value in truth.items():
        assert abs(d.disturbed.values[name][0] - value) <= 3.0 * d.disturbed.values[name][1], name


@pytest.mark.thorough
def test_a_drift_is_only_possible_where_a_disturbance_does_without_it(tmp_path):
    problem, _ = disturbed_problem(tmp_path, "first", "clean", 3)
    problem = problem.with_recordings({n: drifted(e.recording) for n, e in problem.experiments.items()})
    answer = fit(problem, budget=1500)
    d = diagnose(answer.problem, answer.best.x)
    said = [s["sentence"] for s in diagnosis_record(d)["verdict"]]
    if d.found:
        assert "possibly missing" in said[0]
        assert any(s.startswith("The residual of y as the model is wanders by itself") for s in said)
    assert d.disturbed is not None


def drifted(recording):
    slope = 0.02 * np.std(recording["y"]) / np.ptp(recording.t)
    signals = {**recording.signals, "y": Signal(recording["y"] + slope * recording.t, recording.signals["y"].unit)}
    return Recording(recording.t, signals, recording.name)


def test_the_law_of_the_walk_in_two_recordings_with_gaps():
    rng, left = np.random.default_rng(3), []
    for n in (900, 700):
        r = 5.0 + np.cumsum(0.2 * rng.standard_normal(n)) + 0.5 * rng.standard_normal(n)
        r[100:110] = np.nan
        left.append(Left(r, np.zeros((n, 0)), {"u": rng.standard_normal(n)}))
    left.append(Left(np.full(50, np.nan), np.zeros((50, 0)), {"u": np.zeros(50)}))
    used = usable(left)
    assert len(used) == 2
    walk = wandering(used, whitened(used))
    assert walk is not None
    assert walk.steps == pytest.approx(0.2, rel=0.15)
    assert walk.noise == pytest.approx(0.5, rel=0.1)
    assert walk.moves(4.0) == pytest.approx(2.0 * walk.steps)


@pytest.mark.parametrize("kind", ["white", "short memory", "input", "spread by a lag"])
def test_what_does_not_wander(kind):
    for seed in range(10):
        rng, n = np.random.default_rng(seed), 1000
        u, e, r = np.repeat(rng.uniform(-1, 1, n // 20), 20), rng.standard_normal(n), np.zeros(n)
        if kind == "short memory":
            for k in range(1, n):
                r[k] = 0.9 * r[k - 1] + e[k]
        elif kind == "input":
            r = 3.0 * np.cumsum(u) / 10 + e
        elif kind == "spread by a lag":
            for k in range(1, n):
                r[k] = r[k - 1] + (20.0 * u[k - 1] - r[k - 1]) / 50.0
            r = r + 0.3 * e
        else:
            r = e
        left = usable([Left(r, np.zeros((n, 0)), {"u": u})])
        assert wandering(left, whitened(left)) is None, seed


def test_a_parameter_that_the_innovations_do_not_show_has_no_value():
    """One that two columns hold alike, and one that is nowhere; the others keep theirs."""
    rng, n = np.random.default_rng(5), 1000
    u = np.repeat(rng.uniform(-1, 1, n // 20), 20)
    columns = np.column_stack([u, 2.0 * u, np.cumsum(u) / 10, np.zeros(n)])
    r = 0.7 * columns[:, 2] + np.cumsum(0.1 * rng.standard_normal(n)) + 0.2 * rng.standard_normal(n)
    found = whitened(usable([Left(r, columns, {"u": u})]))
    assert np.isinf(found.standard_errors[[0, 1, 3]]).all()
    assert found.moved[2] == pytest.approx(0.7, abs=3 * found.standard_errors[2])
    assert found.standard_errors[2] < 0.2


@pytest.mark.thorough
def test_where_a_parameter_ends_at_a_bound_the_walk_is_told_without_values(tmp_path):
    """Steps along derivatives say nothing of the others then."""
    problem, _ = disturbed_problem(tmp_path, "first", "clean", 1)
    answer = fit(problem, budget=1500)
    free = diagnose(answer.problem, answer.best.x, rounds=1).disturbed
    assert free is not None
    assert set(free.values) == {"K", "tau"}
    (value, error), given = free.values["tau"], problem.space.parameters
    tight = {**given, "tau": replace(given["tau"], bounds=(0.01, value - 0.2 * error), start=None)}
    answer = fit(Problem(problem.model, problem.experiments, tight, scales=problem.scales), budget=1500)
    d = diagnose(answer.problem, answer.best.x, rounds=1)
    assert d.disturbed is not None
    assert d.disturbed.values == {}
    said = diagnosis_record(d)["verdict"][-1]["sentence"]
    assert "wanders by itself" in said
    assert "With that allowed for" not in said
