"""A parameter, a load or a sensor's offset that is another one from a moment on: told with its moment and its values,
and not of noise, drifts, ramps or other errors of the model."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS
from benchmarks.steps import FALSE, TRUE, course_of, record, right, study_of

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.errors import ModelError
from plantfit.models.extensions import with_extensions
from plantfit.models.library.process import first_order
from plantfit.spec import load, parse, with_additions
from plantfit.trust.diagnosis import changed, diagnose, diagnosis_record
from plantfit.trust.diagnosis.plant.unmeasured import steps_of, with_unmeasured
from plantfit.trust.verdict.parameters import parameter_sentences

AT = {"bounds": [-5, 5], "at": [1.0, 15.0]}


def problem_with(kind: str, signal: str) -> Problem:
    named = {"inputs": {"u": ""}, "outputs": {"y": ""}, "states": {"x": {}}, "parameters": {"K": {}, "tau": {}}}
    plain = equations("x' = (K*u - x)/tau; y = x", **named)
    t = np.linspace(0.0, 20.0, 401)
    recording = Recording(t, {"u": Signal(np.ones(401), ""), "y": Signal(0.0 * t, "")}, "a")
    return Problem(with_extensions(plain, {kind: {signal: AT}}), {"a": recording}, {"K": 3.0, "tau": 2.0})


@pytest.mark.parametrize(
    ("kind", "signal", "size", "more"),
    [
        ("step", "K", 0.4, lambda t: 3.0 * 0.4 * (1.0 - np.exp(-t / 2.0))),
        ("load_step", "x", 0.7, lambda t: 0.7 * 2.0 * (1.0 - np.exp(-t / 2.0))),
        ("sensor_step", "y", 0.5, lambda t: 0.5 + 0.0 * t),
    ],
)
def test_a_step_begins_exactly_at_its_moment(kind, signal, size, more):
    problem, at = problem_with(kind, signal), 7.013  # between two samples
    assert problem.space.names == (f"{kind}_{signal}", f"{kind}_{signal}_at")
    t = problem.experiments["a"].recording.t
    expected = 3.0 * (1.0 - np.exp(-t / 2.0)) + np.where(t >= at, more(np.maximum(t - at, 0.0)), 0.0)
    np.testing.assert_allclose(problem.predict(np.array([size, at]))["y"], expected, atol=1e-5)


@pytest.mark.thorough
def test_a_parameter_keeps_its_sign_and_derivatives_by_the_moment_are_exact():
    problem = problem_with("step", "K")
    t = problem.experiments["a"].recording.t
    least = problem.predict(np.array([-3.0, 7.013]))["y"]
    assert least[-1] == pytest.approx(0.05 * 3.0, abs=5e-3)
    z, h = np.array([0.55, 0.4313]), 1e-6
    _, exact = problem.residuals_and_jacobian(z)
    differences = [
        (np.asarray(problem.residuals(z + d)) - np.asarray(problem.residuals(z - d))) / (2 * h) for d in h * np.eye(2)
    ]
    np.testing.assert_allclose(exact, np.stack(differences, axis=1), atol=1e-5 * np.abs(exact).max())
    assert np.abs(exact[:, 1]).max() > 0.0
    assert not exact[t < 7.0, 1].any()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"step": {"K": [-1, 1]}}, "it is at a moment, so write bounds and between which times (s) that is"),
        ({"step": {"K": {"bounds": [-1, 1], "at": [3, 3]}}}, "write where to look for its moment (s), as in [0, 1]"),
        ({"step": {"G": {"bounds": [-1, 1], "at": [0, 3]}}}, "which is not one of its parameters that can change"),
    ],
)
def test_what_is_no_step_is_refused_in_words(given, said):
    with pytest.raises(ModelError) as refused:
        with_extensions(first_order(dead_time=False), given)
    assert said in str(refused.value)


def diagnosed(folder, plant, what, size, seed):
    """The study, its diagnosis without additions to the model, and the moment."""
    place, at = study_of(plant, what, size, seed, folder)
    study = load(place)
    course = course_of(study.problem)
    made = course.diagnosis([])
    return study, with_unmeasured(course, made, None, steps_of(course, made)), at


@pytest.mark.thorough
def test_a_parameter_that_changes_is_told_with_its_moment_and_both_values(tmp_path):
    study, d, at = diagnosed(tmp_path, "first", "K", -0.15, 3)
    assert d.stepping is not None
    (one,) = d.stepping.steps
    assert one.place.name == "step of K"
    assert one.within[0] <= at <= one.within[1]
    assert one.within[1] - one.within[0] < 0.02 * study.problem.experiments["a"].recording.t[-1]
    for found, truth in ((one.before, 8.0), (one.behind, 6.8), (d.stepping.values["tau"], 0.6)):
        assert found is not None
        assert abs(found[0] - truth) < 3.0 * found[1] < 0.01 * truth
    text = diagnosis_record(d)["verdict"][-1]["sentence"]
    assert text.startswith("K changes at t = ")
    assert " K/V to " in text
    assert "With that allowed for tau = " in text
    new = parse(with_additions(study.text, study.path, changed(d), name="new"), tmp_path / "new.toml").problem
    assert new.space.names == ("K", "tau", "step_K", "step_K_at")
    low, high = (float(b[new.space.names.index("step_K_at")]) for b in (new.space.lower, new.space.upper))
    assert low < at < high


@pytest.mark.thorough
def test_where_inputs_jump_the_fit_beside_a_moment_is_not_stuck(tmp_path):
    d = diagnosed(tmp_path, "motor", "J", 0.5, 2)[1]
    assert d.stepping is not None
    (one,) = d.stepping.steps
    for found, truth in ((one.before, 2e-4), (one.behind, 3e-4), (d.stepping.values["k"], 0.05)):
        assert found is not None
        assert abs(found[0] - truth) < 2.0 * found[1] < 0.5 * truth


@pytest.mark.parametrize("limit", [100.0, 1e9])
def test_work_that_does_not_suffice_for_a_step_is_not_silent(tmp_path, limit):
    course = course_of(load(study_of("first", "K", -0.15, 3, tmp_path)[0]).problem)
    course.carrier.meter.limit = course.carrier.meter.spent + limit
    assert (steps_of(course, course.diagnosis([])) is None) is (limit < 1e3)
    assert course.whole is (limit > 1e3)


@pytest.mark.slow
def test_loads_that_no_record_tells_apart_are_told_together(tmp_path):
    _, d, at = diagnosed(tmp_path, "motor", "load", 0.1, 3)
    assert d.stepping is not None
    assert {s.place.name for s in d.stepping.steps} == {"load step of i", "load step of w"}
    text = diagnosis_record(d)["verdict"][-1]["sentence"]
    assert text.startswith("The rate of ")
    assert "this record cannot tell it from another one: the rate of " in text
    assert len(diagnosis_record(d)["stepping"]["steps"]) == 2
    assert sum(line.endswith("_at]") for line in diagnosis_record(d)["write"]) == 1
    assert any(s.within[0] - 0.01 <= at <= s.within[1] + 0.01 for s in d.stepping.steps)


@pytest.mark.parametrize(
    ("plant", "what"),
    [
        ("first", "drift"),
        pytest.param("first", "ramp of a parameter", marks=pytest.mark.slow),
        ("first", "dead_time"),
        ("first", "AR noise"),
        pytest.param("first", "offset", marks=pytest.mark.slow),
        pytest.param("second", "drift", marks=pytest.mark.slow),
        pytest.param("motor", "offset", marks=pytest.mark.slow),
    ],
)
@pytest.mark.thorough
def test_nothing_else_is_called_a_step(tmp_path, plant, what):
    assert _told(tmp_path, plant, what, 0.0, 3) is None


def test_parameters_are_not_called_determined_without_a_word_on_the_step(tmp_path):
    study, d, _ = diagnosed(tmp_path, "first", "K", -0.15, 4)
    assert d.stepping is not None
    findings, made = fit(study.problem, budget=200).findings, diagnosis_record(d)
    findings = {**findings, "parameters": [{**p, "status": "determined"} for p in findings["parameters"]]}
    told = [
        next(s for s in parameter_sentences({**findings, "diagnosis": one}) if s["sentence"].startswith("The data det"))
        for one in (made, {**made, "stepping": None})
    ]
    at = f"{d.stepping.steps[0].at:.4g}"
    text = f"A step at t = {at} s is left, and these are values without it: the plant's may be others, by more than ±"
    assert text in told[0]["sentence"]
    assert told[0]["level"] == "warning"
    assert text not in told[1]["sentence"]


def test_a_step_is_tried_where_it_is_asked_for(tmp_path):
    study = load(study_of("first", "clean", 0.0, 5, tmp_path)[0])
    answer = fit(study.problem, budget=200)
    d = diagnose(answer.problem, answer.best.x, only="step of the sensor of y")
    assert [c.name for c in changed(d)] == ["step of the sensor of y"]
    (text,) = (s["sentence"] for s in diagnosis_record(d)["verdict"])
    assert text.startswith("Step of the sensor of y: at t = ")
    assert "sensor_step = {y = {bounds" in with_additions(study.text, study.path, changed(d))
    with pytest.raises(ModelError, match="There is no 'step of G' to try"):
        diagnose(answer.problem, answer.best.x, only="step of G")


def test_nothing_is_looked_at_where_samples_are_uneven_or_recordings_are_several():
    made, _ = record(PLANTS["first"], "K", -0.15, 3)
    from plantfit.trust.diagnosis.plant.stepping.moments import step_places

    def places(*times):
        model = first_order(dead_time=False)
        own = {
            f"r{k}": Recording(t, {"u": Signal(made.u, "V"), "y": Signal(made.y, "K")}, f"r{k}")
            for k, t in enumerate(times)
        }
        return step_places(Problem(model, own), np.full(Problem(model, own).space.dimension, 0.5))

    uneven = made.t + 0.4 * made.t[1] * np.sin(np.arange(len(made.t)))
    assert places(made.t)
    assert not places(uneven)
    assert not places(made.t, made.t)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "what", "size"), [("first", "K", -0.15), ("second", "b", 0.4), ("tanks", "a1", -0.15)]
)
def test_the_whole_diagnosis_tells_the_step_and_the_new_study_has_it(tmp_path, plant, what, size):
    place, at = study_of(plant, what, size, 6, tmp_path)
    study = load(place)
    answer = fit(study.problem, budget=800)
    d = diagnose(answer.problem, answer.best.x)
    assert d.stepping is not None
    new = fit(parse(with_additions(study.text, study.path, changed(d), name="new"), tmp_path / "new.toml").problem)
    assert new.values[f"step_{what}"] == pytest.approx(size, rel=0.05)
    assert new.values[f"step_{what}_at"] == pytest.approx(at, abs=3.0 * PLANTS[plant].period)


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
def test_steps_over_many_records(tmp_path, plant):
    named = []
    for what, size in [(w, size) for p, w, size in TRUE if p == plant]:
        for seed in (20, 21):
            one = _told(tmp_path, plant, what, size, seed)
            named.append(one is not None and any(right(plant, what, s.place) for s in one.steps))
    wrong = [_told(tmp_path, plant, what, 0.0, 20) is not None for p, what in FALSE if p == plant]
    assert np.mean(named) >= 0.8
    assert np.sum(wrong) <= 1


def _told(folder, plant, what, size, seed):
    course = course_of(load(study_of(plant, what, size, seed, folder)[0]).problem)
    return steps_of(course, course.diagnosis([]))


@pytest.mark.thorough
def test_a_step_is_told_with_its_own_first_values():
    """The fit without it has put the first value of a plant that forgets it late far off: m was 1.5017 ± 0.0004."""
    rng, t = np.random.default_rng(3), 0.2 * np.arange(1000)
    force, v = np.where(t % 90 < 40, 3.0, 0.0), np.full(1000, 12.0)
    for k in range(999):
        m, x = 1.5 if t[k] < 80.0 - 1e-9 else 1.9, v[k]
        for _ in range(4):
            middle = x + 0.025 * (force[k] - 0.16 - 4e-4 * x * x) / m
            x += 0.05 * (force[k] - 0.16 - 4e-4 * middle * middle) / m
        v[k + 1] = x
    model = equations(
        "v' = (u - r - c*v^2)/m\ny = v", inputs=["u"], states={"v": {"initial": "y"}}, outputs=["y"],
        parameters=["m", "r", "c"], check=False,
    )  # fmt: skip
    bounds = {"m": (0.5, 4.0), "r": (0.01, 1.0), "c": (5e-5, 5e-3)}
    recording = Recording(t, {"u": Signal(force), "y": Signal(v + 0.05 * rng.normal(size=1000))}, "road")
    answer = fit(Problem(model, recording, {k: Parameter(b, scale="log") for k, b in bounds.items()}, split=0.7))
    found = diagnose(answer.problem, answer.best.x, rounds=1).stepping
    assert found is not None
    step = found.steps[0]
    assert step.place.name == "step of m"
    assert step.before is not None
    assert step.behind is not None
    told = [step.before, step.behind, found.values["r"], found.values["c"]]
    for (value, error), true in zip(told, (1.5, 1.9, 0.16, 4e-4), strict=True):
        assert abs(value - true) < 3.0 * error
