"""Residuals of a simulation that begins at a noisy measured value: white but for that, unless something else is missing."""

import numpy as np
import pytest
from scipy.signal import lfilter

import plantfit as pf
from plantfit.trust.intervals.linearised import named_blocks
from plantfit.trust.validate.noisy_start import left_by_first_values

PERIOD, N = 0.1, 400


def fitted(seed, tau=2.0, off=None, lag=0.0, initial="y", noise=0.02):
    """A lag with K 2 in random steps, measured from x = 1.5 on; `off`: of the first value, in standard deviations; `lag`: a second one."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, 1.0, N // 25).repeat(25)
    pole = np.exp(-PERIOD / tau)
    x = lfilter([0.0, 2.0 * (1 - pole)], [1.0, -pole], u) + 1.5 * pole ** np.arange(N)
    if lag:
        second = np.exp(-PERIOD / lag)
        x = lfilter([1 - second], [1.0, -second], x, zi=[second * 1.5])[0]
    errors = noise * rng.standard_normal(N)
    if off is not None:
        errors[0] = off * noise
    recording = pf.Recording(PERIOD * np.arange(N), {"u": pf.Signal(u, "V"), "y": pf.Signal(x + errors, "K")}, "bench")
    model = pf.equations(
        "x' = (K*u - x)/tau\ny = x", inputs={"u": "V"}, states={"x": {"unit": "K", "initial": initial}}, outputs={"y": "K"},
        parameters={"K": "K/V", "tau": "s"},
    )  # fmt: skip
    return pf.fit(pf.Problem(model, recording, {"K": (0.1, 20.0), "tau": (0.1, 50.0)}), budget=600)


def test_residuals_of_a_right_model_are_white_whatever_the_first_value_is():
    """Of 12 records whose first value is 2.5 standard deviations off, 9 or more failed the test before."""
    tests = [fitted(seed, tau=6.0, off=2.5 * (-1) ** seed).findings["residual_tests"][0] for seed in range(12)]
    assert sum(t["white"] for t in tests) >= 11
    taken_off = [t["first"] for t in tests if t["first"] is not None]
    assert len(taken_off) >= 5
    for seed, t in enumerate(tests):
        if t["first"] is not None:
            assert t["first"] == pytest.approx(0.05 * (-1) ** seed, abs=0.03)


def test_the_sentence_says_what_is_taken_off():
    answer = next(a for seed in range(12) if (a := fitted(seed, tau=6.0, off=2.5)).findings["residual_tests"][0]["first"] is not None)
    assert "but for what noise of the first value leaves, where the simulation begins (0.0" in str(answer.verdict)
    assert "something systematic is missing" not in str(answer.verdict)


@pytest.mark.parametrize("changes", [{"lag": 0.5}, {"off": 12.0, "tau": 6.0}, {"initial": 1.2, "tau": 6.0}])
def test_what_is_missing_is_told_all_the_same(changes):
    """A second lag, a first value that no noise explains, a start that nobody measured."""
    for seed in range(4):
        (test,) = fitted(seed, **changes).findings["residual_tests"]
        assert not test["white"]
        assert test["first"] is None


def test_what_is_taken_off_stands_beside_the_residuals():
    """Rows and signs: the part that the first value leaves is like the mean residual of records that differ in noise alone."""
    answer = fitted(1, tau=6.0, off=3.0)
    problem = answer.problem
    z = problem.space.cube(problem.space.vector(answer.values))
    left, off = left_by_first_values(problem, np.asarray(z))["bench", "y"]
    residual = problem.experiments["bench"].recording["y"] - problem.predict(problem.space.vector(answer.values), "bench")["y"]
    assert [b.rows for _, _, b in named_blocks(problem)] == [slice(0, N)]
    assert np.sum((residual - left) ** 2) < 0.97 * np.sum(residual**2)
    assert off == pytest.approx(0.06, abs=0.03)
