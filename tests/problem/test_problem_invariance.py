"""Fitted parameters do not depend on clocks, units, the order of recordings or the weight of a single output."""

from dataclasses import replace

import numpy as np
import pytest
from problem_motors import line, line_recording
from scipy.optimize import least_squares

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter


def fitted(problem) -> dict[str, float]:
    """Least squares from a corner of the box, never the truth."""
    found = least_squares(
        lambda z: problem.residuals_and_jacobian(z)[0],
        np.full(problem.space.dimension, 0.05),
        jac=lambda z: problem.residuals_and_jacobian(z)[1],
        bounds=(0.0, 1.0),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    return dict(zip(problem.space.names, np.asarray(problem.space.physical(found.x)).tolist(), strict=True))


def ordinary(recording):
    matrix = np.c_[recording["u"], np.ones(len(recording))]
    return np.linalg.lstsq(matrix, recording["y"])[0]


def test_a_static_fit_is_ordinary_least_squares():
    recording = line_recording(seed=4)
    a, b = ordinary(recording)
    assert fitted(Problem(line(), recording)) == pytest.approx({"a": a, "b": b}, rel=1e-8)


def test_shifting_the_clock_changes_nothing():
    recording = line_recording()
    moved = Recording(recording.t + 123.4, recording.signals, recording.name)
    assert fitted(Problem(line(), moved)) == pytest.approx(fitted(Problem(line(), recording)), rel=1e-8)


def test_scaling_an_output_scales_its_parameters():
    recording = line_recording()
    scaled = Recording(recording.t, {"u": recording.signals["u"], "y": Signal(2.0 * recording["y"])}, recording.name)
    once, twice = fitted(Problem(line(), recording)), fitted(Problem(line(), scaled))
    assert twice == pytest.approx({k: 2.0 * v for k, v in once.items()}, rel=1e-8)


@pytest.mark.parametrize("scale", [1e-3, 7.0])
def test_the_weight_of_a_single_output_does_not_matter(scale):
    recording = line_recording()
    assert fitted(Problem(line(), recording, scales={"y": scale})) == pytest.approx(
        fitted(Problem(line(), recording)), rel=1e-7
    )


def test_the_order_of_recordings_does_not_matter():
    one, two = line_recording(seed=1, name="one"), line_recording(seed=2, name="two", b=3.0)
    change = {"b": Parameter((-5, 5), per_recording=True)}
    there, back = (Problem(line(), r, change) for r in ({"one": one, "two": two}, {"two": two, "one": one}))
    assert fitted(there) == pytest.approx(fitted(back), rel=1e-8)


def test_units_of_bounds_do_not_matter():
    rad = Problem(line(), line_recording(), {"b": Parameter((-5.0, 5.0), "rad/s")})
    rpm = Problem(line(), line_recording(), {"b": Parameter((-150.0 / np.pi, 150.0 / np.pi), "rpm")})
    assert fitted(rpm) == pytest.approx(fitted(rad), rel=1e-8)
    assert rpm.space.coordinates[1].unit == "rad/s"


def test_holding_and_tying_parameters():
    recording = line_recording(seed=5)
    held = fitted(Problem(line(), recording, {"b": 0.25}))
    assert set(held) == {"a"}
    assert held["a"] == pytest.approx(
        recording["u"] @ (recording["y"] - 0.25) / (recording["u"] @ recording["u"]), rel=1e-8
    )
    with pytest.raises(SpaceError, match="whose number it would take as it is"):
        Problem(line(), recording, {"b": Parameter(tied="a")})  # rad/s and rad/s/V
    one_unit = replace(line(), parameters=tuple(replace(p, unit=None) for p in line().parameters))
    tied = fitted(Problem(one_unit, recording, {"b": Parameter(tied="a")}))
    v = recording["u"] + 1.0
    assert tied["a"] == pytest.approx(v @ recording["y"] / (v @ v), rel=1e-8)


def test_wider_bounds_given_as_a_pair_replace_the_declared_ones():
    problem = Problem(line(), line_recording(), {"a": (-20, 40)})
    assert (problem.space.lower[0], problem.space.upper[0]) == (-20.0, 40.0)
