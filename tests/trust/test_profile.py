"""Profile intervals against closed forms, against a profile by scipy, and by coverage."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

import plantfit as pf
from plantfit.errors import SpaceError
from plantfit.models.library.process import first_order
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.intervals.profile import profile
from plantfit.trust.validate.dead_time import dead_time

T = np.arange(200) * 0.1
TRUTH = {"K": 2.0, "tau": 1.5, "L": 0.73}
MIDDLE = np.full(3, 0.5)  # of the cube: a profile fits anew from any point
BOX = {"K": (0.5, 5.0), "tau": (0.2, 6.0)}


def line(noise: np.ndarray) -> Problem:
    """y = a + b u with given noise (200,)."""
    model = pf.equations(
        "y = a + b*u",
        inputs={"u": "1"},
        outputs={"y": "1"},
        parameters={"a": {"bounds": [-9, 9]}, "b": {"bounds": [-9, 9]}},
    )
    u = np.sin(T)
    return Problem(model, Recording(T, {"u": Signal(u, "1"), "y": Signal(1.0 + 2.0 * u + noise, "1")}))


@lru_cache(maxsize=4)
def step(late: float, noise: float, seed: int, low: float = 0.0, high: float = 3.0, n: int = 200) -> Problem:
    """A step through a first order process with dead time, from its closed form."""
    t = T[:n]
    y = TRUTH["K"] * -np.expm1(-np.maximum(t - late, 0.0) / TRUTH["tau"]) + noise * np.random.default_rng(
        seed
    ).standard_normal(n)
    record = Recording(t, {"u": Signal(np.ones(n)), "y": Signal(np.r_[0.0, y[1:]])})
    changes = {**BOX, "L": (low, high)}
    return Problem(
        first_order(offset=False), Experiment(record, fit=(0.05, np.inf), before={"u": 0.0}), changes, substeps=1
    )


def test_a_straight_line_has_the_interval_of_the_text_book():
    noise = 0.3 * np.random.default_rng(1).standard_normal(200)
    problem = line(noise)
    x = np.column_stack([np.ones(200), np.sin(T)])
    base, squares = np.linalg.lstsq(x, problem.data["measured"]["recording"]["y"])[:2]
    error = np.sqrt(squares[0] / 198 * np.linalg.inv(x.T @ x)[1, 1])
    found = profile(problem, problem.space.cube([0.0, 1.0]), "b")
    half = np.sqrt(found.inflation * chi2.ppf(0.95, 1)) * error
    assert found.value == pytest.approx(base[1], abs=1e-6)
    assert (found.low, found.high) == pytest.approx((base[1] - half, base[1] + half), rel=2e-3)
    assert not found.at_lower
    assert not found.at_upper


def test_correlated_noise_widens_by_what_it_should():
    ratios = []
    for seed in range(8):
        white = np.random.default_rng(seed).standard_normal(400)
        slow = np.zeros(400)
        for k in range(1, 400):
            slow[k] = 0.6 * slow[k - 1] + white[k]
        ratios.append(profile(line(0.2 * slow[200:]), np.array([0.55, 0.6]), "a").inflation)
    assert np.median(ratios) == pytest.approx(1.6 / 0.4, rel=0.35)  # (1 + rho)/(1 - rho) of a mean


def test_the_profile_of_a_dead_time_is_that_of_scipy():
    problem = step(TRUTH["L"], 0.02, 3)
    found = profile(problem, MIDDLE, "L")
    y = problem.data["measured"]["recording"]["y"]

    def squares(p, late):
        return np.sum((p[0] * -np.expm1(-np.maximum(T[1:] - late, 0.0) / p[1]) - y) ** 2)

    def least(late):
        return minimize(
            squares, (2.0, 1.5), args=(late,), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
        ).fun

    variance = least(found.value) / (len(y) - 3)
    for value, excess in zip(found.points, found.excess, strict=True):
        assert excess == pytest.approx((least(value) - least(found.value)) / variance, abs=0.01 + 0.01 * excess)
    for end in (found.low, found.high):
        assert (least(end) - least(found.value)) / variance == pytest.approx(found.threshold, rel=0.08)


def test_a_dead_time_that_the_record_tells():
    found = dead_time(step(TRUTH["L"], 0.02, 3), MIDDLE)
    assert found.determined
    assert found.interval[0] < TRUTH["L"] < found.interval[1]
    assert found.interval[1] - found.interval[0] < 0.1
    assert found.sentence.startswith("The dead time L is 0.7")


@pytest.mark.parametrize(
    ("late", "noise", "low", "high", "said"),
    [
        (0.0, 0.05, 0.0, 3.0, "cannot be told from zero"),
        (0.15, 0.05, 0.15, 3.0, "is at most"),
        (0.99, 0.05, 0.0, 1.0, "is at least"),
        (0.5, 5.0, 0.2, 0.6, "does not tell the dead time"),
    ],
)
@pytest.mark.further(3)
def test_a_dead_time_that_leans_on_its_bounds_is_said(late, noise, low, high, said):
    found = dead_time(step(late, noise, 4, low, high, n=100), MIDDLE)
    assert not found.determined
    assert said in found.sentence


def test_wrong_names_are_refused():
    with pytest.raises(SpaceError, match="no parameter 'x'"):
        profile(line(np.zeros(200)), np.full(2, 0.5), "x")
    with pytest.raises(SpaceError, match="it has none; use a model with dead time"):
        dead_time(line(np.zeros(200)), np.full(2, 0.5))


@pytest.mark.slow
def test_intervals_of_a_dead_time_hold_what_they_promise():
    inside = []
    for seed in range(100):
        low, high = dead_time(step(TRUTH["L"], 0.1, seed), MIDDLE).interval
        inside.append(low <= TRUTH["L"] <= high)
    assert 0.88 <= np.mean(inside) <= 0.99  # 95 % within three standard deviations of 100 draws
