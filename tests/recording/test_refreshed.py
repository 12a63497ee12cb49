"""Outputs that are read more seldom than they are recorded: told with the line that keeps the fresh samples, and no
others."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit import Problem, Recording, Signal, equations, fit
from plantfit.errors import RecordingError
from plantfit.recording import keep_every
from plantfit.recording.looks import signal_looks
from plantfit.recording.looks.refreshed import refreshed_look

N = 800
T = 0.1 * np.arange(N)


def plant(seed, noise=0.01):
    """An input of two levels and a lag of 1.5 s behind it, gain 2."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([1.0, 4.0], N // 15 + 1), 15)[:N]
    a = np.exp(-0.1 / 1.5)
    y = lfilter([0.0, 2.0 * (1.0 - a)], [1.0, -a], u - u[0]) + 2.0 * u[0]
    return u, y + noise * rng.normal(size=N)


def record(y):
    return Recording(T, {"y": Signal(np.asarray(y), "V")}, "r")


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_repeats_and_straight_lines_are_told_with_their_first_fresh_sample(noise):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        every = int(rng.integers(2, 26))
        first = int(rng.integers(0, every))
        y = plant(seed, noise)[1]
        held = y[np.maximum((np.arange(N) - first) // every * every + first, 0)]
        for kind, values in (
            ("held", held),
            ("held", np.round(held, 2)),
            ("filled", np.interp(T, T[first::every], y[first::every])),
        ):
            look = refreshed_look(record(values), "y")
            assert look is not None
            assert (look.kind, look.figures["every"], look.figures["first"]) == (kind, every, first)
            assert f"every = {every}, first = {first}" in look.write


def test_plain_outputs_are_left_alone():
    for seed in range(60):
        y = plant(seed, [0.0, 0.001, 0.01, 0.1][seed % 4])[1]
        smoothed = np.convolve(np.pad(y, 4, mode="edge"), np.ones(9) / 9, "valid")
        for values in (
            y,
            *(np.round(y / d) * d for d in (0.01, 0.1, 0.5)),
            smoothed,
            np.clip(y, 3.0, 7.0),
            np.where(T > 40, np.nan, y),
        ):
            assert refreshed_look(record(values), "y") is None


def test_a_rounded_output_that_bends_at_every_step_of_its_input_is_no_line():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(0.0, 5.0, N // 25), 25)
        y = lfilter([0.0, 0.13], [1.0, -0.935], u)
        assert refreshed_look(record(np.round(y, 2)), "y") is None


def test_the_line_takes_the_repeats_away_and_intervals_hold():
    held = {"as it is": 0, "fresh": 0}
    model = equations(
        "y' = (K*u - y)/tau", inputs=["u"], states={"y": {"initial": "y0"}}, outputs=["y"],
        parameters={"K": {"bounds": (0.1, 10.0)}, "tau": {"bounds": (0.1, 20.0)}, "y0": {"bounds": (-50.0, 50.0)}},
    )  # fmt: skip
    for seed in range(3):
        u, y = plant(seed)
        r = Recording(T, {"u": Signal(u), "y": Signal(np.repeat(y[::8], 8)[:N])}, "r")
        look = next(k for k in signal_looks(r, "y", True) if k.kind == "held")
        fresh = keep_every(r, "y", int(look.figures["every"] or 0), int(look.figures["first"] or 0))
        assert not any(k.kind in ("held", "filled") for k in signal_looks(fresh, "y", True))
        for name, recording in (("as it is", r), ("fresh", fresh)):
            row = fit(Problem(model, recording), budget=400, seed=1).findings["parameters"][1]
            held[name] += row["low"] <= 1.5 <= row["high"]
    assert held["as it is"] == 0
    assert held["fresh"] == 3


@pytest.mark.parametrize(("every", "first"), [(1, 0), (2.5, 0), (4, 4), (4, -1), (True, 0)])
def test_what_no_samples_are_is_refused(every, first):
    with pytest.raises(RecordingError, match="give a whole number from"):
        keep_every(record(plant(1)[1]), "y", every, first)


def test_the_samples_that_are_kept_are_counted_from_nought():
    kept = keep_every(record(np.arange(N)), "y", 4, 3)
    assert np.flatnonzero(np.isfinite(kept["y"]))[:3].tolist() == [3, 7, 11]
    assert kept.log[-1] == "Of 'y' every 4th sample kept, from sample 3 on."
