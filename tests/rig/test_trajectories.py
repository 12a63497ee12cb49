"""Rest-to-rest moves against the regularised incomplete beta function, of which they are a polynomial case."""

import numpy as np
import pytest
from scipy.special import betainc

from plantfit.errors import SimulationError
from plantfit.rig import Move, RestToRest

T = np.linspace(0.0, 10.0, 100_001)
PATH = RestToRest(1.0, (Move(1.0, 2.0, 3.0), Move(5.0, 4.0, -1.0)), smoothness=5)


def test_moves_are_the_incomplete_beta_function():
    expected = (
        1.0 + 2.0 * betainc(6, 6, np.clip((T - 1.0) / 2.0, 0, 1)) - 4.0 * betainc(6, 6, np.clip((T - 5.0) / 4.0, 0, 1))
    )
    np.testing.assert_allclose(PATH(T), expected, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_derivatives_are_those_of_the_value_and_continuous(order):
    slope = np.gradient(PATH(T, order - 1), T)
    scale = np.max(np.abs(PATH(T, order)))
    # away from where the next derivative jumps
    inner = np.all(np.abs(T[:, None] - [1.0, 3.0, 5.0, 9.0]) > 3e-4, axis=1)
    np.testing.assert_allclose(PATH(T, order)[inner][1:-1], slope[inner][1:-1], atol=1e-6 * scale)
    assert np.max(np.abs(np.diff(PATH(T, order)))) < 1e-2 * scale  # no jump at the ends of a move


def test_one_derivative_more_jumps():
    assert np.max(np.abs(np.diff(PATH(T, 6)))) > 0.1 * np.max(np.abs(PATH(T, 6)))


@pytest.mark.parametrize(
    ("moves", "said"),
    [
        ((Move(1.0, 0.0, 1.0),), "duration > 0"),
        ((Move(1.0, 2.0, 1.0), Move(2.0, 1.0, 0.0)), "start it later"),
        ((Move(0, 1, np.nan),), "finite"),
    ],
)
def test_impossible_moves_are_refused(moves, said):
    with pytest.raises(SimulationError, match=said):
        RestToRest(0.0, moves)


def test_smoothness_is_a_whole_number():
    with pytest.raises(SimulationError, match="whole number"):
        RestToRest(0.0, (), smoothness=2.5)  # pyrefly: ignore[bad-argument-type]
