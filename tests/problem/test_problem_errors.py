"""Every refusal names what is wrong and what to do."""

import numpy as np
import pytest
from problem_motors import line, line_recording

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError, SpaceError, UnitError
from plantfit.models import dc_motor
from plantfit.problem import Experiment, Problem, split
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter

TWO = {"one": line_recording(name="one"), "two": line_recording(name="two")}
EMPTY = Recording(np.arange(3.0), {"u": Signal(np.ones(3)), "y": Signal(np.full(3, np.nan))}, "empty")


@pytest.mark.parametrize(
    ("recordings", "settings", "error", "words"),
    [
        ({}, {}, RecordingError, ["at least one recording"]),
        (TWO, {"split": 0.5}, RecordingError, ["split works on one recording", "validate"]),
        (TWO, {"validate": ["three"]}, RecordingError, ["'three'", "'one'", "'two'"]),
        (line_recording(), {"split": 1.5}, RecordingError, ["split = 1.5", "between 0 and 1"]),
        (line_recording(), {"split": 0.0}, RecordingError, ["split = 0", "0.7"]),
        (line_recording(n=1), {"split": 0.5}, RecordingError, ["1 samples", "too few"]),
        (EMPTY, {}, RecordingError, ["No measured sample", "missing values"]),
        (Experiment(line_recording(), fit=(90.0, 99.0)), {}, RecordingError, ["No measured sample", "fit interval"]),
        (line_recording(unit="kg"), {}, UnitError, ["'y'", "'kg'", "'rad/s'"]),
        (line_recording(), {"parameters": {"c": 1.0}}, SpaceError, ["'c'", "'a'", "'b'"]),
        (line_recording(), {"parameters": {"a": {"bounds": (1, 3)}}}, SpaceError, ["'a'", "Parameter((low, high)"]),
        (line_recording(), {"parameters": {"a": (3, 1)}}, SpaceError, ["'a'", "[3, 1]", "[1, 3]"]),
        (line_recording(), {"parameters": {"b": Parameter((0, 1), "kg")}}, UnitError, ["'b'", "'kg'", "'rad/s'"]),
        (line_recording(), {"parameters": {"b": Parameter(tied="q")}}, SpaceError, ["'q'", "does not exist"]),
        (line_recording(), {"scales": {"x": 1.0}}, SpaceError, ["'x'", "['y']"]),
        (line_recording(), {"scales": {"y": 0.0}}, SpaceError, ["'y'", "0.0", "positive"]),
        (line_recording(), {"scales": {"y": np.nan}}, SpaceError, ["'y'", "nan"]),
    ],
)
def test_refusals(recordings, settings, error, words):
    with pytest.raises(error) as caught:
        Problem(line(), recordings, **settings)
    message = str(caught.value)
    assert all(w in message for w in words), message
    assert "\n" not in message


def test_a_signal_that_the_model_needs_is_named():
    recording = Recording(np.arange(3.0), {"y": Signal(np.ones(3))}, "bench")
    with pytest.raises(RecordingError, match=r"'bench' has no signal 'u', which the model needs; it has \['y'\]"):
        Problem(line(), recording)


def test_a_close_name_is_suggested():
    recording = Recording(np.arange(3.0), {"V": Signal(np.ones(3)), "w": Signal(np.ones(3))})
    with pytest.raises(SpaceError, match="; did you mean 'Rm'"):
        Problem(dc_motor(), recording, {"Rmm": 1.0})


def test_predict_names_an_unknown_recording():
    with pytest.raises(RecordingError, match=r"no recording 'other'; there are \['line'\]"):
        Problem(line(), line_recording()).predict([1.0, 0.0], "other")


def test_split_of_an_experiment_alone_names_its_share():
    with pytest.raises(RecordingError, match="split = -1"):
        split(line_recording(), -1.0)


def test_a_parameter_of_its_own_needs_a_fitted_part():
    t = np.arange(20.0)
    record = Recording(t, {"V": Signal(np.ones(20), "V"), "w": Signal(np.ones(20), "rad/s")})
    own = {"Tf": Parameter((1e-6, 1e-2), "N*m", per_recording=True)}
    with pytest.raises(SpaceError, match="'new' is not fitted at all"):
        Problem(dc_motor(), {"old": record, "new": record}, own, validate=["new"])
    part = Experiment(record, fit=(0.0, 5.0), validate=(5.0, 20.0))
    assert "Tf[new]" in Problem(dc_motor(), {"old": record, "new": part}, own).space.names
