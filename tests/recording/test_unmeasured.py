"""Outputs that a recording does not measure."""

import numpy as np
import pytest

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal
from plantfit.recording.unmeasured import unmeasured
from plantfit.spec import load

STUDY = """
name = "two sensors"
[recording.first]
file = "first.csv"
unmeasured = ["b"]
[recording.second]
file = "second.csv"
{second}
[model]
equations = '''
a = k*u
b = k*u + c
'''
inputs = ["u"]
outputs = ["a", "b"]
[parameters]
k = {{ bounds = [0, 10] }}
c = {{ bounds = [0, 10] }}
"""


def study(folder, second, header="t,u,b"):
    t = np.arange(20.0)
    u = np.sin(t)
    np.savetxt(folder / "first.csv", np.column_stack([t, u, 3.0 * u]), delimiter=",", header="t,u,a", comments="")
    np.savetxt(folder / "second.csv", np.column_stack([t, u, 3.0 * u + 2.0]), delimiter=",", header=header, comments="")
    (folder / "study.toml").write_text(STUDY.format(second=second), "utf-8")
    return load(folder / "study.toml")


def test_each_output_is_scored_only_where_it_was_measured(tmp_path):
    problem = study(tmp_path, 'unmeasured = ["a"]').problem
    counts = {n: {o: len(i) for o, i in row.items()} for n, row in problem.data["index"].items()}
    assert counts == {"first": {"a": 20, "b": 0}, "second": {"a": 0, "b": 20}}
    r = np.asarray(problem.residuals(problem.space.cube(problem.space.vector({"k": 3.0, "c": 2.0}))))
    assert r == pytest.approx(np.zeros(40), abs=1e-12)
    off = np.asarray(problem.residuals(problem.space.cube(problem.space.vector({"k": 3.0, "c": 2.5}))))
    assert off * problem.scales["b"] == pytest.approx(np.r_[np.zeros(20), np.full(20, 0.5)], abs=1e-12)


def test_an_output_that_is_missing_unsaid_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="'second' has no signal 'a'"):
        study(tmp_path, "")


def test_an_output_measured_nowhere_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="'b' has no measured sample"):
        study(tmp_path, 'unmeasured = ["b"]', header="t,u,a")


def test_a_signal_that_is_there_cannot_be_unmeasured():
    recording = Recording(np.arange(3.0), {"a": Signal(np.zeros(3), "V")}, "run", ())
    with pytest.raises(RecordingError, match="has the signal 'a', but unmeasured names it too; remove one"):
        unmeasured(recording, ["a"])
    made = unmeasured(recording, ["b"])
    assert np.all(np.isnan(made["b"]))
    assert made.log == ("b: not measured here.",)
