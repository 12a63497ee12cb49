"""Why no parameter is called determined: too few samples, or residuals that move too slowly. Each is told as what it
is."""

import numpy as np
import pytest

from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.optimize.local.separable import Block, usable
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
    model = equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"], parameters=parameters
    )
    found = fit(Problem(model, Recording(t, {"u": Signal(np.ones(samples)), "y": Signal(y)})), seed=1)
    return [v["sentence"] for v in found.findings["verdict"] if "No parameter is called determined" in v["sentence"]]


@pytest.mark.parametrize("seed", range(3))
def test_few_samples_are_told_as_few(seed):
    [sentence] = told(8, walk=False, seed=seed)
    assert sentence.startswith(
        f"No parameter is called determined: 8 {FEW}, and intervals may be too short. The data allow these at least: K "
    )
    assert "; tau " in sentence
    assert sentence.endswith(" Give more samples, or free fewer parameters.")


@pytest.mark.parametrize("seed", range(3))
def test_enough_white_samples_are_not_told(seed):
    assert told(60, walk=False, seed=seed) == []


def test_slow_residuals_are_told_as_slow():
    said = [s for seed in range(4) for s in told(60, walk=True, seed=seed)]
    assert said
    assert all(SLOW in s and FEW not in s for s in said)


def test_beside_intervals_that_are_too_short_nothing_is_said_of_an_interval():
    """No sentence "K cannot be told from zero: 0 to 36" beside "intervals may be too short", none of ends that the
    data do not set."""
    met = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        t = 0.1 * np.arange(150)
        u = np.sin(0.3 * t + seed) + 1.2
        y = 2.0 * u + np.cumsum([0.02, 0.1, 0.5, 2.0][seed % 4] * rng.standard_normal(150))
        bounds = {"K": {"bounds": (0.01, 10.0)}, "tau": {"bounds": (0.1, 20.0)}}
        model = equations(
            "x' = (K*u - x)/tau", inputs=["u"], states={"x": {"initial": 2.0}}, outputs=["x"], parameters=bounds
        )
        found = fit(Problem(model, Recording(t, {"u": Signal(u), "x": Signal(y)})), seed=1).findings
        said = " ".join(v["sentence"] for v in found["verdict"])
        if found["determined"]["sound"]:
            continue
        met += 1
        assert not any(
            w in said
            for w in (
                "cannot be told from zero: ",
                "only roughly known",
                "hardly known",
                "it is at least",
                "it is at most",
            )
        )
        assert "first add what the model lacks" in said
        assert "standard errors allow for it" not in said
    assert met >= 4


def test_a_search_that_meets_numbers_without_a_square_ends():
    big = np.full((3, 2), 1e200)
    assert usable(np.ones(3), np.ones((3, 2)))
    assert not usable(np.ones(3), big)
    assert not usable(np.array([1.0, np.nan]), np.ones((2, 1)))
    block = Block(np.arange(2), np.full(2, 0.5), np.ones(3), np.ones((3, 2)))
    block.update(np.array([0.1, 0.1]), 1.0, np.zeros(3), big)
    assert np.all(block.jacobian == 1.0)  # refused


def test_beside_a_wander_of_a_right_model_no_response_is_called_incomplete():
    """Residuals that are worth few samples follow a slow input by chance."""
    told = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        t = 0.1 * np.arange(300)
        u = np.sin(0.4 * t + seed) + 0.5 * np.sin(0.13 * t) + 2.0
        x = np.empty(300)
        x[0] = 2.0 * u[0]
        for k in range(299):
            x[k + 1] = 2.0 * u[k] + (x[k] - 2.0 * u[k]) * np.exp(-0.1 / 1.5)
        y = x + 0.05 * np.cumsum(rng.standard_normal(300)) + 0.02 * rng.standard_normal(300)
        bounds = {"K": {"bounds": (0.01, 10.0)}, "tau": {"bounds": (0.1, 20.0)}}
        model = equations(
            "x' = (K*u - x)/tau", inputs=["u"], states={"x": {"initial": "x"}}, outputs=["x"], parameters=bounds
        )
        found = fit(Problem(model, Recording(t, {"u": Signal(u), "x": Signal(y)})), budget=400, seed=1).findings
        if found["determined"]["sound"]:
            continue
        said = " ".join(v["sentence"] for v in found["verdict"])
        told += "so few independent samples do not tell" in said
        assert "response to it is incomplete" not in said
    assert told >= 1
