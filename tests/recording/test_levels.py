"""A staircase is cut where its input moves, and nothing is lost."""

import numpy as np
import pytest

from plantfit.errors import RecordingError
from plantfit.recording.clean.levels import levels
from plantfit.recording.record import Recording, Signal


def staircase(counts, values):
    u = np.repeat(values, counts)
    t = 2.0 * np.arange(len(u)) + 0.01 * np.sin(np.arange(len(u)))  # samples a little late or early
    return Recording(t, {"u": Signal(u, "V"), "y": Signal(np.arange(len(u), dtype=float), "degC")}, "plant")


def test_every_sample_is_in_one_level():
    record = staircase([20, 31, 40], [0.4, 0.55, 0.4])
    pieces = levels(record, "u")
    assert [len(p) for p in pieces] == [20, 31, 40]
    assert [p.name for p in pieces] == ["plant_1", "plant_2", "plant_3"]
    assert [float(p["u"][0]) for p in pieces] == [0.4, 0.55, 0.4]
    np.testing.assert_array_equal(np.concatenate([p["y"] for p in pieces]), record["y"])
    np.testing.assert_array_equal(np.concatenate([p.t for p in pieces]), record.t)


def test_what_is_no_staircase_is_refused():
    with pytest.raises(RecordingError, match="'u' of recording 'plant' never moves"):
        levels(staircase([30], [1.0]), "u")
    with pytest.raises(RecordingError, match="'y' of recording 'plant' moves at 29 of 30 samples"):
        levels(staircase([30], [1.0]), "y")
    with pytest.raises(RecordingError, match="has no signal 'v'"):
        levels(staircase([20, 20], [1.0, 2.0]), "v")
