"""The recordings of the demos are read whole, in their units, and belong to whom they say."""

from importlib.resources import files

import numpy as np
import pytest

from plantfit.cases import demos
from plantfit.cases.shared.files import unpack
from plantfit.errors import StoreError
from plantfit.spec import load

STUDIES = [  # demo, file, recording, samples, seconds, signal, unit, least, most
    ("gearmotor", "gearmotor.toml", "prbs", 4093, 81.84, "y", "deg/s", 83.5, 219),
    ("tanks", "tanks.toml", "tanks", 1024, 4092.0, "level", "V", 2.9, 10.0),
    ("emps", "free_run.toml", "emps", 24841, 24.84, "q", "m", 0.0, 0.26),
    ("emps", "closed_loop.toml", "emps", 24841, 24.84, "u", "V", -10.0, 10.0),
]


@pytest.mark.parametrize(("demo", "file", "name", "samples", "seconds", "signal", "unit", "least", "most"), STUDIES)
def test_recording(tmp_path, demo, file, name, samples, seconds, signal, unit, least, most):
    study = load(unpack(demo, tmp_path) / file)
    record = study.problem.experiments[name].recording
    assert len(record) == samples
    assert record.t[-1] - record.t[0] == pytest.approx(seconds, rel=1e-3)
    assert record.signals[signal].unit == unit
    assert record[signal].min() >= least - 1e-3
    assert record[signal].max() <= most + 1e-3
    masks = [study.problem.experiments[name].mask(p) for p in ("fit", "validation")]
    assert np.any(masks[1])
    assert not np.any(masks[0] & masks[1])


def test_force_recording_is_filtered_and_decimated(tmp_path):
    record = load(unpack("emps", tmp_path) / "force.toml").problem.experiments["emps"].recording
    assert len(record) == 2475
    assert np.median(np.diff(record.t)) == pytest.approx(0.01)
    assert record.signals["acceleration"].unit is not None
    speed_from_position = np.gradient(record["position"], record.t)
    assert np.corrcoef(speed_from_position[5:-5], record["velocity"][5:-5])[0, 1] > 0.999


def recordings_of(name):
    return [p.name for p in files(f"plantfit.cases.{name}").iterdir() if p.name.endswith((".csv", ".gz"))]


@pytest.mark.parametrize("name", [n for n in sorted(demos()) if recordings_of(n)])
def test_source_travels_with_the_data(tmp_path, name):
    text = (unpack(name, tmp_path) / "README.md").read_text("utf-8")
    assert "Source: github repository" in text
    assert any(licence in text for licence in ("Licence: MIT", "licence Apache-2.0", "Licence: BSD 3-Clause"))
    assert not [n for n in recordings_of(name) if n not in text]


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(StoreError, match="choose another folder"):
        unpack("tanks", tmp_path / "taken")
