"""Why no parameter is called determined: too few samples, or residuals that move too slowly. Each is told as what it is."""

import numpy as np
import pytest

from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal

FEW, SLOW = "fitted samples are too few for 2 parameters", "the residuals move so slowly"


def told(samples, walk, seed):
    """Sentences on a first-order plant after a step: white noise, or a walk."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 4.0, samples)
    noise = 0.02 * rng.normal(size=samples)
    y = 2.0 * (1.0 - np.exp(-t / 0.8)) + (0.3 * np.cumsum(noise) if walk else noise)
    parameters = {"K": {"bounds": (0.1, 10.0)}, "tau": {"bounds": (0.1, 5.0)}}
    model = equations("x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"], parameters=parameters)
    found = fit(Problem(model, Recording(t, {"u": Signal(np.ones(samples)), "y": Signal(y)})), seed=1)
    return [v["sentence"] for v in found.findings["verdict"] if "No parameter is called determined" in v["sentence"]]


@pytest.mark.parametrize("seed", range(3))
def test_few_samples_are_told_as_few(seed):
    [sentence] = told(8, walk=False, seed=seed)
    assert sentence == f"No parameter is called determined: 8 {FEW}, and the intervals too short."


@pytest.mark.parametrize("seed", range(3))
def test_enough_white_samples_are_not_told(seed):
    assert told(60, walk=False, seed=seed) == []


def test_slow_residuals_are_told_as_slow():
    said = [s for seed in range(4) for s in told(60, walk=True, seed=seed)]
    assert said
    assert all(SLOW in s and FEW not in s for s in said)
