"""What `fit` gives back, against closed forms and against its own findings."""

import dataclasses
import json
import pickle
import subprocess
import sys

import numpy as np
import plotly.graph_objects as go
import polars as pl
import pytest
from face_plants import TRUTH, heated, heater_answer, heater_model, lasting, line, response

import plantfit as pf
from plantfit.errors import ModelError, PlantfitError, RecordingError, SpaceError, UnitError
from plantfit.optimize.contract import RunResult
from plantfit.problem import new_recording

LOAD = """
import json, pickle, sys
answer = pickle.load(open(sys.argv[1], "rb"))
made = "findings" in answer.__dict__
predicted = {k: [float(v).hex() for v in y] for k, y in answer.predict().items()}
print(json.dumps([made, {k: v.hex() for k, v in answer.values.items()}, predicted, answer.findings]))
"""


@pytest.fixture(scope="module")
def heater():
    return heater_answer()


@pytest.fixture(scope="module")
def straight():
    problem, u, y = line()
    return pf.fit(problem, "least_squares", budget=200), u, y


def test_values_are_the_truth_within_their_standard_errors(heater):
    assert list(heater.values) == ["K", "T0", "tau"]
    for name, value in heater.values.items():
        assert abs(value - TRUTH[name]) < 4 * heater.standard_errors[name]


def test_standard_errors_are_those_of_the_findings_and_variances_their_squares(heater):
    rows = {row["name"]: row["standard_error"] for row in heater.findings["parameters"]}
    assert heater.standard_errors == rows
    np.testing.assert_allclose(np.diag(heater.covariance.matrix), np.array(list(rows.values())) ** 2, rtol=1e-12)
    np.testing.assert_array_equal(np.diag(heater.correlation.matrix), 1.0)
    assert heater.covariance.names == ("K", "T0", "tau")
    assert heater.covariance.units == ("degC/W", "degC", "s")
    assert heater.covariance["K", "tau"] == heater.covariance["tau", "K"] == np.asarray(heater.covariance)[0, 2]


def test_covariance_of_a_line_is_that_of_textbooks(straight):
    answer, u, y = straight
    columns = np.stack([u, np.ones_like(u)], axis=1)
    best, (squares,), *_ = np.linalg.lstsq(columns, y, rcond=None)
    covariance = squares / (len(u) - 2) * np.linalg.inv(columns.T @ columns)
    np.testing.assert_allclose(list(answer.values.values()), best, rtol=1e-6)
    np.testing.assert_allclose(answer.covariance.matrix, covariance, rtol=1e-3)
    assert answer.correlation["a", "c"] == pytest.approx(-u.mean() / np.sqrt(np.mean(u**2)), rel=1e-6)


def test_what_is_not_determined_has_no_standard_error_and_no_covariance():
    problem, *_ = line("y = a*b*u + c", b={"bounds": (0.1, 10.0)})
    answer = pf.fit(problem, "least_squares", budget=200)
    errors, matrix = answer.standard_errors, answer.covariance
    assert np.isnan(errors["a"])
    assert np.isnan(errors["b"])
    assert errors["c"] == pytest.approx(np.sqrt(matrix["c", "c"]))
    assert np.isnan(matrix["a", "a"])
    assert np.isnan(matrix["a", "c"])
    assert np.isnan(answer.correlation["b", "b"])
    assert "+-" in repr(answer).split("c = ")[1]
    assert "+-" not in repr(answer).split("a = ")[1].split("\n")[0]


def test_an_entry_of_no_parameter_is_refused(straight):
    with pytest.raises(PlantfitError, match=r"no entry \('a', 'd'\).*\['a', 'c'\]"):
        straight[0].covariance["a", "d"]
    assert straight[0].covariance.to_frame().columns == ["parameter", "a", "c"]


@pytest.mark.thorough
def test_residuals_are_measured_minus_simulated_and_missing_where_nothing_was_measured():
    t = np.arange(0.0, 240.0, 2.0)
    full = heated(t)
    y = full["T"].copy()
    y[[7, 50]] = np.nan
    r = pf.Recording(t, {"u": full.signals["u"], "T": pf.Signal(y, "degC")}, "bench")
    problem = pf.Problem(heater_model(), {"one": r, "two": heated(t, 60.0, seed=2)}, validate=["two"])
    answer = pf.fit(problem, "least_squares", budget=300)
    assert list(answer.residuals) == ["one", "two"]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(answer.residuals["one"]["T"])), [7, 50])
    for name, record in (("one", r), ("two", problem.experiments["two"].recording)):
        np.testing.assert_array_equal(answer.residuals[name]["T"], record["T"] - answer.simulated[name]["T"])
        np.testing.assert_allclose(answer.simulated[name]["T"], response(t, record["u"]), atol=0.1)
        shown = next(f for f in answer.findings["recordings"] if f["name"] == name)["outputs"]["T"]["simulated"]
        np.testing.assert_array_equal(answer.simulated[name]["T"], shown)


# predictions


def test_a_recording_of_the_problem_is_predicted_as_simulated(heater):
    t = np.arange(0.0, 240.0, 2.0)
    for same in (None, "bench", heated(t), heated(t, name="renamed")):
        np.testing.assert_array_equal(heater.predict(same)["T"], heater.simulated["bench"]["T"])


@pytest.mark.parametrize("step", [0.5, 2.0, 20.0])
@pytest.mark.further(2)
def test_a_new_recording_is_predicted_as_the_closed_form_says(heater, step):
    t = 100.0 + np.arange(0.0, 400.0, step)
    u = np.where((t // 40) % 3 == 0, 20.0, 60.0)
    new = pf.from_arrays({"t": t, "u": (u / 1000, "kW")})  # no T: the model does not begin at one; another unit
    truth = response(t, u, **heater.values)
    np.testing.assert_allclose(heater.predict(new)["T"], truth, atol=1e-3 * float(np.std(truth)))


def test_draws_over_a_new_recording_compile_no_program_anew(heater):
    new = pf.from_arrays({"t": np.arange(0.0, 100.0, 2.0), "u": (np.linspace(0.01, 0.06, 50), "kW")})
    heater.predict(new)
    before = new_recording._compiled.cache_info().misses
    heater.predict(new, values={"K": 0.9})
    assert new_recording._compiled.cache_info().misses == before


def test_one_new_value_of_one_parameter(heater):
    t = np.arange(0.0, 240.0, 2.0)
    r = heated(t)
    truth = response(t, r["u"], **{**heater.values, "tau": 60.0})
    np.testing.assert_allclose(heater.predict(r, values={"tau": 60.0})["T"], truth, atol=1e-3 * float(np.std(truth)))
    np.testing.assert_array_equal(heater.predict(values=heater.values)["T"], heater.predict()["T"])


@pytest.mark.thorough
def test_a_model_that_begins_at_the_first_measured_value_needs_one():
    t = np.arange(0.0, 200.0, 1.0)
    u = np.where((t // 25) % 2 == 0, 1.0, 0.0)
    model = pf.models.make("first_order", dead_time=False, offset=False)
    y = response(t, u, K=2.0, T0=0.0, tau=9.0)
    problem = pf.Problem(model, pf.from_arrays({"t": t, "u": u, "y": y + 1e-3 * np.sin(t)}))
    answer = pf.fit(problem, "least_squares", budget=300)
    nothing = np.full(len(t), np.nan)
    with pytest.raises(
        RecordingError,
        match="'monday' has no value of 'y', and the model 'first_order' begins at the first measured one",
    ):
        answer.predict(pf.from_arrays({"t": t, "u": u}, name="monday"))
    begun = answer.predict(pf.from_arrays({"t": t, "u": u, "y": np.r_[0.7, nothing[1:]]}))["y"]
    free = answer.predict(pf.from_arrays({"t": t, "u": u, "y": np.r_[0.0, nothing[1:]]}))["y"]
    np.testing.assert_allclose(begun - free, 0.7 * np.exp(-t / answer.values["tau"]), atol=2e-3)


@pytest.mark.thorough
def test_a_value_per_recording_is_asked_for():
    t = np.arange(0.0, 120.0, 2.0)
    problem = pf.Problem(
        heater_model(),
        {"one": heated(t), "two": heated(t, 60.0)},
        {"T0": pf.Parameter((0.0, 50.0), "degC", per_recording=True)},
    )
    answer = pf.fit(problem, "least_squares", budget=300)
    new = pf.from_arrays({"t": t, "u": 0 * t}, name="new")
    with pytest.raises(
        SpaceError, match=r"'T0' has a value for each of the recordings \['one', 'two'\] and none for 'new'"
    ):
        answer.predict(new)
    np.testing.assert_allclose(answer.predict(new, values={"T0": 18.0})["T"], 18.0, atol=1e-9)


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        (
            lambda t: pf.from_arrays({"t": t, "T": 0 * t}, name="new"),
            RecordingError,
            "'new' has no signal 'u', which the model needs",
        ),
        (
            lambda t: pf.from_arrays({"t": t, "u": (t, "s")}, name="new"),
            UnitError,
            "'u' is in 's', which cannot be converted to",
        ),
        (
            lambda t: pf.from_arrays({"t": t, "u": np.where(t > 9, np.nan, 1.0)}),
            PlantfitError,
            "'u' is missing at sample 10",
        ),
        (lambda t: "benhc", RecordingError, "no recording 'benhc'"),
        (lambda t: {"u": t}, RecordingError, "dict is no recording to predict over"),
    ],
)
def test_what_cannot_be_predicted_over_is_said_in_a_sentence(heater, given, error, says):
    with pytest.raises(error, match=says) as told:
        heater.predict(given(np.arange(20.0)))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"k": 1.0}, "'k', which is not one of"),
        ({"K": [1.0, 2.0]}, "'K' as"),
        ({"K": np.nan}, "'K' as nan"),
        ({"K": "one"}, "'K' as 'one'"),
    ],
)
def test_values_that_are_none_are_refused(heater, values, says):
    with pytest.raises(SpaceError, match=says):
        heater.predict(values=values)


# how it is shown


def test_a_row_for_each_parameter():
    problem, *_ = line(c={"value": 1.0})
    answer = pf.fit(problem, "least_squares", budget=100)
    frame = answer.to_frame()
    assert frame["parameter"].to_list() == ["a", "c"]
    assert frame["status"].to_list() == ["determined", "fixed"]
    assert frame["value"].to_list() == [answer.values["a"], 1.0]
    assert frame["standard_error"].to_list() == [answer.standard_errors["a"], None]
    row = answer.findings["parameters"][0]
    assert frame.row(0, named=True) == {"parameter": "a", **{c: row[c] for c in frame.columns[1:]}}
    assert frame.schema["low"] == pl.Float64
    assert frame.schema["open"] == pl.String


def test_a_figure_has_what_was_measured_and_simulated_and_real_colours(heater):
    figure = heater.plot()
    assert isinstance(figure, go.Figure)
    drawn = {trace.name: trace for trace in figure.data}
    assert set(drawn) == {"measured", "simulated", "residual", "input u"}
    np.testing.assert_allclose(np.array(drawn["simulated"].y, dtype=float), heater.simulated["bench"]["T"], rtol=1e-5)
    assert "var(" not in figure.to_json()
    with pytest.raises(RecordingError, match="no recording 'x'"):
        heater.plot("x")


def test_a_notebook_shows_verdict_and_parameters_and_nothing_runs_in_it(heater):
    page = heater._repr_html_()
    for v in heater.findings["verdict"]:
        assert v["sentence"].split(":")[0].split("'")[0] in page
    assert "<script" not in page
    evil = dataclasses.replace(heater)
    evil.__dict__["findings"] = {**heater.findings, "name": "<script>alert(1)</script>"}
    assert "&lt;script&gt;" in evil._repr_html_()
    assert "<script" not in evil._repr_html_()


def test_repr_waits_for_nothing_and_fits_on_a_screen(heater):
    fresh = dataclasses.replace(heater)
    assert "findings" not in fresh.__dict__
    text = repr(fresh)
    assert "findings" not in fresh.__dict__
    assert text.split("\n")[0].startswith("Answer 'heater': least_squares, 1 run, cost ")
    assert f"K = {heater.values['K']:.6g} degC/W" in text
    names = [f"c{k}" for k in range(60)]
    model = pf.equations(
        "y = " + " + ".join(f"{n}*u" for n in names),
        inputs=["u"],
        outputs=["y"],
        parameters={n: {"bounds": (0, 1)} for n in names},
    )
    problem = pf.Problem(model, pf.from_arrays({"u": np.ones(9), "y": np.ones(9)}, period=1.0))
    run = RunResult("random", 0, 0, np.full(60, 0.5), 1.0, 1.0, 0.0, pf.Status.budget, np.ones(1), np.ones(1))
    many = repr(pf.Answer(problem, [run], 0))
    assert "and 40 more" in many
    assert len(many.split("\n")) <= 24


def test_summary_holds_every_sentence_and_parameter(heater):
    words = " ".join(heater.summary().split())
    for v in heater.findings["verdict"]:
        assert v["sentence"] in words
    for name in heater.values:
        assert f"\n{name} " in heater.summary()


# pickles


def _elsewhere(answer, path):
    path.write_bytes(pickle.dumps(answer))
    told = subprocess.run([sys.executable, "-c", LOAD, str(path)], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return json.loads(told.stdout)


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.thorough
def test_an_answer_is_the_same_in_another_process(heater, tmp_path, asked):
    answer = heater if asked else dataclasses.replace(heater)
    assert bool(answer.findings) if asked else "findings" not in answer.__dict__
    made, values, predicted, findings = _elsewhere(answer, tmp_path / "a.pickle")
    assert made == asked
    assert values == {k: v.hex() for k, v in heater.values.items()}
    assert predicted == {k: [float(v).hex() for v in y] for k, y in heater.predict().items()}
    assert lasting(findings) == lasting(json.loads(json.dumps(heater.findings)))


def test_models_that_were_changed_and_steps_that_were_made_finer_are_pickled_too():
    t = np.arange(0.0, 60.0, 1.0)
    u = np.where((t // 9) % 2 == 0, 1.0, 0.0)
    model = pf.models.make("first_order", dead_time=False, offset=False, initial="free")
    r = pf.from_arrays({"t": t, "u": u, "y": response(t, u, K=2.0, T0=0.0, tau=5.0)}, name="run")
    problem = pf.Problem(model, r, clock_shift={"u": (-1.0, 1.0)}, scales={"y": 0.5})
    finer = problem.with_simulator(problem.predictor.stepping().refined(4))
    z = np.full(finer.space.dimension, 0.4)
    again = pickle.loads(pickle.dumps(finer))
    np.testing.assert_array_equal(np.asarray(again.residuals(z)), np.asarray(finer.residuals(z)))
    assert again.predictor.stepping().substeps == 4
    assert repr(again) == repr(finer)


def test_functions_that_are_local_are_named():
    def output(x, u, p):
        return {"y": p["a"] * u["u"]}

    local = pf.Model("mine", {}, {"u": None}, {"y": None}, (pf.Declared("a", bounds=(0, 1)),), output)
    with pytest.raises(
        ModelError, match="Model 'mine' cannot be pickled, because its output is or holds a function that is local"
    ):
        pickle.dumps(local)
    changed = dataclasses.replace(pf.models.make("dc_motor"), name="other")  # not what the call of dc_motor makes
    with pytest.raises(ModelError, match="Model 'other' cannot be pickled"):
        pickle.dumps(changed)


def test_a_model_of_functions_of_a_module_is_pickled():
    model = pf.Model("mine", {}, {"u": None}, {"y": None}, (pf.Declared("a", bounds=(0, 1)),), twice)
    assert pickle.loads(pickle.dumps(model)) == model


def test_what_a_model_was_made_of_may_change_afterwards():
    parameters = {"a": {"bounds": (0.0, 1.0)}}
    model = pf.equations("y = a*u", inputs=["u"], outputs=["y"], parameters=parameters)
    parameters["a"]["bounds"] = (5.0, 6.0)
    assert pickle.loads(pickle.dumps(model)).parameters == model.parameters


@pytest.mark.parametrize("name", pf.models.names())
def test_every_library_model_is_pickled(name):
    model = pf.models.make(name)
    again = pickle.loads(pickle.dumps(model))
    assert (again.name, again.parameters, again.outputs) == (model.name, model.parameters, model.outputs)


def twice(x, u, p):
    return {"y": 2 * p["a"] * u["u"]}
