"""Scrambled Sobol points are those of scipy, bit for bit."""

import warnings

import numpy as np
import pytest
from scipy.stats import qmc

from plantfit.sobol import MOST_DIMENSIONS, Sobol


@pytest.mark.parametrize("dimension", [1, 2, 3, 7, 40, 310, 2000])
def test_points_are_those_of_scipy(dimension):
    ours = Sobol(dimension, np.random.default_rng(dimension))
    theirs = qmc.Sobol(dimension, scramble=True, rng=np.random.default_rng(dimension))
    for n in (1, 5, 16, 300):  # drawn in turns, as searches do
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            expected = theirs.random(n)
        np.testing.assert_array_equal(ours.random(n), expected)


def test_no_points_are_none():
    assert Sobol(3, np.random.default_rng(0)).random(0).shape == (0, 3)


def test_dimensions_without_direction_numbers_are_refused():
    assert MOST_DIMENSIONS == qmc.Sobol.MAXDIM
    with pytest.raises(ValueError, match="not in 21202"):
        Sobol(MOST_DIMENSIONS + 1, np.random.default_rng(0))
    with pytest.raises(ValueError, match="not in 0"):
        Sobol(0, np.random.default_rng(0))
