"""Recordings predicted from the others, against linear algebra on the others alone."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.trust.validate.left_out import left_out_recordings

LOADS = {"a": 1.0, "b": 2.0, "c": 4.0, "d": 5.0}


def records(seed=0, n=50):
    rng, made = np.random.default_rng(seed), {}
    for name, load in LOADS.items():
        u = rng.uniform(-1.0, 1.0, n)
        y = 2.0 * u + 0.3 * load + 0.1 * rng.normal(size=n)
        made[name] = Recording(np.arange(float(n)), {"u": Signal(u), "y": Signal(y)}, name)
    return made


def line(given, own):
    model = equations(
        "y = b*u + c",
        inputs={"u": None},
        outputs={"y": None},
        parameters={"b": {"bounds": (-9, 9)}, "c": {"bounds": (-9, 9)}},
    )
    return Problem(model, given, {"c": Parameter((-9.0, 9.0), per_recording=own)})


def test_shared_parameters_are_those_of_the_others():
    given = records()
    problem = line(given, False)
    found = left_out_recordings(problem, fit(problem, seed=1).best.x)
    for name, r in given.items():
        rest = [o for n, o in given.items() if n != name]
        u, y = (np.concatenate([o[s] for o in rest]) for s in "uy")
        b, c = np.polyfit(u, y, 1)
        assert found[name] == pytest.approx(np.sqrt(np.mean((b * r["u"] + c - r["y"]) ** 2)), rel=1e-6)


def test_own_parameters_lie_on_the_line_through_the_neighbours():
    given = records(1)
    problem = line(given, True)
    z = fit(problem, seed=1).best.x
    found = left_out_recordings(problem, z, LOADS)
    names = list(given)
    for name, (left, right) in {"a": ("b", "c"), "b": ("a", "c"), "c": ("b", "d"), "d": ("b", "c")}.items():
        rest = [n for n in names if n != name]
        columns = np.vstack([np.c_[given[n]["u"], np.outer(np.ones(50), [float(n == m) for m in rest])] for n in rest])
        b, *offsets = np.linalg.lstsq(columns, np.concatenate([given[n]["y"] for n in rest]), rcond=None)[0]
        at = dict(zip(rest, offsets, strict=True))
        share = (LOADS[name] - LOADS[left]) / (LOADS[right] - LOADS[left])
        c = at[left] + share * (at[right] - at[left])
        wanted = np.sqrt(np.mean((b * given[name]["u"] + c - given[name]["y"]) ** 2))
        assert found[name] == pytest.approx(wanted, rel=1e-6)
        assert found[name] < 0.16


def test_what_cannot_be_predicted_is_refused():
    given = records(2)
    problem = line(given, True)
    with pytest.raises(ModelError, match="'c' is per recording; give along"):
        left_out_recordings(problem, np.full(problem.space.dimension, 0.5))
    two = line({n: given[n] for n in "ab"}, False)
    with pytest.raises(ModelError, match="give three or more"):
        left_out_recordings(two, np.full(2, 0.5))
