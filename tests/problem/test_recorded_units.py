"""Units of recordings where the model declares none: one for the whole problem, and for what is predicted."""

import pickle

import numpy as np
import pytest

import plantfit as pf
from plantfit.errors import EquationError, UnitError
from plantfit.models.extensions import with_extensions
from plantfit.problem.new_recording import NewRecording

T = np.arange(40.0)


def recording(u, y="degC", name="r"):
    return pf.Recording(T, {"u": pf.Signal(np.sign(np.sin(T)), u), "y": pf.Signal(0.1 * T, y)}, name)


def problem(recordings, k: str | None = None, tau: str | None = "s", **changes):
    model = pf.equations(
        "x' = (k*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], parameters={"k": k, "tau": tau}
    )
    return pf.Problem(model, recordings, {"k": (0.0, 1.0), "tau": (1.0, 10.0), **changes})


def test_recordings_in_two_units_are_refused():
    with pytest.raises(UnitError) as caught:
        problem({"a": recording("mV", name="a"), "b": recording("V", name="b")})
    assert "'u' is in 'mV' in recording 'a' and in 'V' in 'b'" in str(caught.value)
    assert 'as in u = "mV"' in str(caught.value)


@pytest.mark.parametrize("other", ["V", "volt", None])
def test_recordings_in_one_unit_are_not(other):
    problem({"a": recording("V", name="a"), "b": recording(other, name="b")})


def test_what_is_predicted_is_converted_to_what_was_fitted():
    fitted = pickle.loads(pickle.dumps(problem(recording("mV"))))
    new = NewRecording.of(fitted, recording("V", name="new")).experiment.recording
    np.testing.assert_array_equal(new["u"], 1000 * recording("V")["u"])
    with pytest.raises(UnitError, match="cannot be converted"):
        NewRecording.of(fitted, recording("A", name="new"))


@pytest.mark.parametrize(("u", "y"), [("V", "degC"), ("V", "C"), ("A", "degC"), (None, None), ("V", "dB")])
def test_recorded_units_that_fit_or_may_be_misread_are_accepted(u, y):
    problem(recording(u, y), k="degC/V")


def test_a_recorded_unit_of_another_size_is_refused():
    with pytest.raises(EquationError, match="input 'u' has the unit 'mV', but must be in V"):
        problem(recording("mV"), k="degC/V")


def test_a_unit_that_the_problem_gives_is_checked_as_one_of_the_model():
    problem(recording("V"), tau=None)
    model = pf.equations("x' = (u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["tau"])
    with pytest.raises(EquationError, match="parameter 'tau' has the unit 'min', but must be in s"):
        pf.Problem(model, recording(None), {"tau": pf.Parameter((1.0, 10.0), unit="min")})


@pytest.mark.parametrize(
    ("unit", "told"), [("degC/h", "give its numbers in 'degC/s'"), ("degC/s", None), ("degC/dB", "logarithmic")]
)
def test_an_addition_to_a_model_without_units_takes_its_times_in_seconds(unit, told):
    model = pf.equations("x' = (u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"], parameters=["tau"])
    model = with_extensions(model, {"drift": {"y": (-1.0, 1.0)}})
    changes = {"tau": (1.0, 10.0), "drift_y": pf.Parameter((-1.0, 1.0), unit=unit)}
    if told is None:
        pf.Problem(model, recording("V"), changes)
        return
    with pytest.raises(UnitError, match=told):
        pf.Problem(model, recording("V"), changes)
