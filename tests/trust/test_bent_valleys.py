"""Ranges in a valley that bends: two exponentials that are nearly one."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks import coverage

NAME, LOW, HIGH = "near exponentials", np.log(1e-3), np.log(1e3)
X = np.linspace(0.05, 4.0, 200)


def growth(y, b):
    """Of the sum of squares over the variance from its least to that with the size b held, by scipy from several
    starts."""

    def curve(p):
        return p[0] * np.exp(-p[1] * X) + p[2] * np.exp(-p[3] * X) - y

    def least(residuals, starts):
        return min(
            2 * least_squares(lambda q: residuals(np.exp(q)), np.log(s), bounds=(LOW, HIGH)).cost for s in starts
        )

    free = least(curve, ([2.0, 0.7, 3.0, 1.0], [0.03, 0.003, 4.9, 0.87], [1.0, 0.3, 4.0, 1.0]))
    held = least(lambda q: curve([q[0], q[1], b, q[2]]), ([2.0, 0.7, 1.0], [0.03, 0.01, 0.9], [5.0 - b, 0.6, 1.2]))
    return (held - free) / (free / (len(X) - 4))


@pytest.mark.parametrize("seed", [8, 9, 23])
def test_a_parameter_that_another_one_frees_is_followed_through_the_bend(seed):
    """At the answer k means nothing and b looks known to 1 %; with k in the middle of its range b may be half as
    large."""
    rig = coverage.RIGS[NAME]
    base = rig.make()
    y = base.predict(base.space.vector(rig.truth))["y"] + coverage.noise_of(rig, len(X), seed)
    assert growth(y, 3.3) < 3.0  # well below the threshold of 3.9
    (found,) = coverage.fits(NAME, [seed])
    _, low, high, value = found["b"]
    assert value > 4.8
    assert low < 3.3 < high


@pytest.mark.parametrize("seed", [35, 51])
def test_a_way_that_is_long_is_followed_to_its_end(seed):
    """The range is as wide as the exact profile; with fewer refits k of 35 and b of 51 looked known to 15 and 2 %."""
    (found,) = coverage.fits(NAME, [seed])
    assert "determined" not in {status for status, *_ in found.values()}


@pytest.mark.parametrize("seed", [13, 33])
def test_what_a_valley_opens_just_beyond_is_not_called_determined(seed):
    """The exact profile ends just before the truth (k at 0.713 for 0.7 with seed 13): one record in twenty is like
    that."""
    (found,) = coverage.fits(NAME, [seed])
    for name in ("a", "k"):
        status, low, high, _ = found[name]
        assert status == "weak"
        assert low < 1.03 * coverage.RIGS[NAME].truth[name]
        assert high > coverage.RIGS[NAME].truth[name]


def test_exponentials_that_differ_stay_determined():
    """Three standard errors leave these where they are."""
    for found in coverage.fits("two exponentials", [1, 2, 3]):
        assert {status for status, *_ in found.values()} == {"determined"}
