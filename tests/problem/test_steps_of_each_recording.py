"""Steps at an answer are fine enough in each recording, not in the mean of all only."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.problem import Problem
from plantfit.problem.accuracy.step_errors import FINE
from plantfit.problem.accuracy.steps import refined_at
from plantfit.problem.accuracy.verification import verify
from plantfit.recording import from_arrays

NOISE = 0.02
BENT = pf.equations(
    "x' = c*(u - x**3)\n y = x",
    inputs=["u"],
    states={"x": {"initial": 1.0}},
    outputs=["y"],
    parameters={"c": {"bounds": (0.5, 5.0)}},
)
T = np.arange(0.0, 60.0, 0.2)


def simulated(u):
    record = from_arrays(T, signals={"u": u, "y": np.zeros(len(T))}, name="fine")
    return Problem(BENT, record, substeps=64).predict(np.array([2.0]))["y"]


def record(name, u, y, seed):
    """Noise alone stands in y: the errors of the steps are those of the simulation, whatever was measured."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(T))
    return from_arrays(T, signals={"u": u, "y": y + noise}, name=name)


@pytest.fixture(scope="module")
def recordings():
    stirred, quiet = np.where(T % 6.0 < 3.0, 1.25, 0.7), np.full(len(T), 1.0)
    y = simulated(quiet)
    found = [record("stirred", stirred, simulated(stirred), 0)]
    found += [record(f"quiet{k}", quiet, y, k) for k in range(1, 25)]
    return {r.name: r for r in found}


def shares(problem, z):
    """The rms error of each recording by an independent solver, over the noise."""
    return {v.recording: v.rms_error / NOISE for v in verify(problem, z)}


@pytest.mark.thorough
def test_what_many_quiet_recordings_hide_in_their_mean_is_refined(recordings):
    problem = Problem(BENT, recordings)
    z = problem.space.cube(problem.space.vector({"c": 2.0}))
    before = shares(problem, z)
    pooled = np.sqrt(np.mean(np.square(list(before.values()))))
    assert pooled < FINE < 0.05 < before["stirred"]
    finer = refined_at(problem, z)
    assert finer.predictor.stepping().substeps > problem.predictor.stepping().substeps
    assert max(shares(finer, z).values()) < 0.05
    assert refined_at(finer, z) is finer
    alone = Problem(BENT, {n: recordings[n] for n in ("quiet1", "quiet2")})
    assert refined_at(alone, z) is alone
