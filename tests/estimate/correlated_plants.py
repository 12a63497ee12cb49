"""Plants whose sensors have noise that is correlated in time, or errors that samples share."""

from typing import Any

import numpy as np
from scipy.signal import lfilter

import plantfit as pf
from plantfit.problem.measure.experiment import Experiment


def autoregression(n, filter_, rng):
    """Noise (n,) with innovations of unit variance."""
    return lfilter([1.0], np.r_[1.0, -np.asarray(filter_)], rng.normal(size=n + 500))[500:]


def oven(seed, correlation=0.8, second=None, n=600, recordings=1, extra="", **options: Any):
    """A first-order oven under steps, sampled every second, with noise of 0.8 degC; `second` is a second time constant
    that the model lacks, `extra` is added to the output with a parameter d."""
    rng, made = np.random.default_rng(seed), {}
    for k in range(recordings):
        u = np.repeat(rng.choice([20.0, 40.0, 60.0, 80.0], size=n // 20), 20)
        drive = u
        if second:
            p = np.exp(-1 / second)
            drive = np.r_[0.0, lfilter([1 - p], [1, -p], u)[:-1]]
        p = np.exp(-1 / 30.0)
        x = np.r_[0.0, lfilter([1.7 * (1 - p)], [1, -p], drive)[:-1]]
        y = x + 22.0 + 0.8 * np.sqrt(1 - correlation**2) * autoregression(n, [correlation], rng)
        made[f"run {k + 1}"] = pf.Recording(np.arange(n) * 1.0, {"u": pf.Signal(u), "y": pf.Signal(y)}, f"run {k + 1}")
    model = pf.equations(
        f"x' = (K*u - x)/tau\ny = x + c{extra}", inputs=["u"], states={"x": {"initial": 0}}, outputs=["y"],
        parameters=["K", "tau", "c", *(["d"] if extra else [])],
    )  # fmt: skip
    bounds = {"K": (0.1, 10), "tau": (1, 300), "c": (0, 50), **({"d": (-50, 50)} if extra else {})}
    return pf.Problem(model, made, bounds, hold={"u": "previous"}, **options)


def encoder(seed, correlated=True, **options: Any):
    """A shaft that runs up, its speed by the slots of a disc of 30 whose edges lie wrong by 2 % of a slot."""
    rng = np.random.default_rng(seed)
    n, slots = 1200, 30
    t = 0.01 * np.arange(n)
    u = np.repeat(rng.choice([4.0, 8.0, 12.0], size=12), 100)
    p = np.exp(-0.01 / 0.4)
    w = np.r_[0.0, lfilter([5.0 * (1 - p)], [1, -p], u)[:-1]] + 1e-9
    edges = 0.02 * rng.normal(size=slots)
    turned = np.cumsum(w) * 0.01 / (2 * np.pi) * slots + slots
    ends = np.arange(int(turned[-1]) + 2)
    last = np.searchsorted(ends + edges[ends % slots], turned) - 1  # the last edge that has passed
    number = (last - 1) % slots  # the slot before it is the one that was timed
    share = edges[(number + 1) % slots] - edges[number] if correlated else 0.02 * rng.normal(size=n)
    y = w / (1 + share) / (1 + (3 if correlated else 1) * 0.02**2) + 0.02 * rng.normal(size=n)  # as period_to_speed
    model = pf.equations(
        "w' = (K*u - w)/tau\nspeed = w", inputs=["u"], states={"w": {"initial": 0}}, outputs=["speed"],
        parameters=["K", "tau"],
    )  # fmt: skip
    recording = pf.Recording(t, {"u": pf.Signal(u), "speed": pf.Signal(y), "slot": pf.Signal(number * 1.0)}, "run")
    taken = Experiment(recording, shared_errors={"speed": "slot"})
    return pf.Problem(model, {"run": taken}, {"K": (0.1, 50), "tau": (0.01, 10)}, hold={"u": "previous"}, **options)
