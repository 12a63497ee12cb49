"""Additions to a model against plants simulated elsewhere (benchmarks/diagnosis.py: Runge-Kutta, no line shared with plantfit)."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # benchmarks are beside the package

from benchmarks.diagnosis import PLANTS, STARTED, write

from plantfit.errors import ModelError, PlantfitError
from plantfit.models.extensions import KINDS, parameter_name, with_extensions
from plantfit.models.library.process import first_order
from plantfit.spec import load

TRUTH = {
    "first": {"K": 8.0, "tau": 0.6},
    "second": {"m": 0.5, "b": 0.8, "k": 4.0},
}
WHERE = {"dead_time": "u", "lag": "u", "dead_zone": "u", "saturation": "u", "backlash": "u", "start": "x", "coulomb": "v", "quadratic": "v"}


@pytest.mark.parametrize("kind", KINDS)
def test_an_addition_is_the_fault_of_its_name(kind, tmp_path):
    plant = PLANTS["second"]
    place = write(plant, kind, 0.0, 0, tmp_path)
    signal, size = WHERE.get(kind, "y"), plant.faults[kind]
    assert kind != "start" or signal == STARTED["second"]
    low = 0 if kind == "dead_time" else -100
    text = place.read_text().replace("[parameters]", f"extensions = {{ {kind} = {{ {signal} = [{low}, 100] }} }}\n[parameters]\n")
    if kind == "coulomb":
        text += "creep_v = { value = 1e-3 }\n"
    place.write_text(text)
    problem = load(place).problem.with_simulator(load(place).problem.predictor.stepping().refined(16))
    bare = load(write(plant, "clean", 0.0, 0, tmp_path)).problem  # the record of another file name would be another one
    values = TRUTH["second"] | {parameter_name(kind, signal): size}
    write(plant, kind, 0.0, 0, tmp_path)
    measured = problem.experiments["a"].recording["y"]
    at = lambda p: p.predict(np.array([values[n] for n in p.space.names]))["y"]  # noqa: E731
    without = at(bare)
    with_it = at(problem)
    error, effect = np.sqrt(np.mean((with_it - measured) ** 2)), np.sqrt(np.mean((without - measured) ** 2))
    assert error < 0.02 * np.std(measured)
    assert error < 0.2 * effect


def test_derivatives_by_additions_are_exact(tmp_path):
    """Except where the input jumps on a sample; sizes are such that nothing stands on a corner."""
    place = write(PLANTS["second"], "clean", 0.01, 0, tmp_path)
    kinds = {
        "lag": "u",
        "dead_zone": "u",
        "saturation": "u",
        "sensor_lag": "y",
        "offset": "y",
        "drift": "y",
        "sensor_high": "y",
        "start": "x",
    }
    given = ", ".join(f"{k} = {{ {s} = [0.011, 2.017] }}" for k, s in kinds.items())
    place.write_text(place.read_text().replace("[parameters]", f"extensions = {{ {given} }}\n[parameters]\n"))
    problem = load(place).problem
    z, h = np.full(problem.space.dimension, 0.37), 1e-6
    _, jacobian = problem.residuals_and_jacobian(z)
    numeric = [(np.asarray(problem.residuals(z + h * e)) - np.asarray(problem.residuals(z - h * e))) / (2 * h) for e in np.eye(len(z))]
    assert np.allclose(jacobian, np.stack(numeric, axis=1), atol=1e-5 * np.abs(jacobian).max())


def test_a_library_model_takes_additions_and_can_be_pickled():
    given = {"dead_zone": {"u": (0, 1)}, "sensor_lag": {"y": (0.01, 1)}}
    model = with_extensions(first_order(dead_time=False), given)
    assert [p.name for p in model.parameters][-2:] == ["dead_zone_u", "sensor_lag_y"]
    again = pickle.loads(pickle.dumps(model))
    assert again.states == model.states


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"dead_tme": {"u": (0, 1)}}, "dead_time"),
        ({"dead_time": {"v": (0, 1)}}, "not one of its inputs"),
        ({"offset": {"u": (0, 1)}}, "not one of its outputs"),
        ({"lag": {"u": (1, 0)}}, "bounds"),
        ({"dead_time": {"u": (0, 1)}}, "one already"),
    ],
)
def test_what_cannot_be_added_is_said(given, said):
    with pytest.raises(ModelError, match=said):
        with_extensions(first_order(), given)


def test_a_regression_takes_none(tmp_path):
    (tmp_path / "a.csv").write_text("t,tau,q,dq,ddq\n" + "\n".join(f"{k * 0.1},{k % 3},{k},{k % 5},{k % 7}" for k in range(30)))
    text = (
        'name = "r"\n[recording.a]\nfile = "a.csv"\n[model]\nkind = "drive_regression"\n'
        "extensions = { offset = { tau = [0, 1] } }\n[parameters]\n"
    )
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(PlantfitError, match="regression"):
        load(tmp_path / "s.toml")
