"""Whether the data press a coordinate onto its bound, or it only happens to stand there."""

import numpy as np
import pytest

from plantfit.trust.intervals.linearised import _held


def judged(z, jacobian, residuals):
    lower, upper = _held(np.asarray(z, dtype=float), jacobian, residuals)
    return ["lower" if a else "upper" if b else "" for a, b in zip(lower, upper, strict=True)]


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1], [1, 2, 0]])
@pytest.mark.parametrize("end", [0.0, 1.0])
def test_of_two_coordinates_known_only_as_a_sum_the_one_on_its_bound_is_not_pressed(end, order):
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 200))
    jacobian = np.column_stack([a, a, b])[:, order]
    residuals = 0.01 * rng.normal(size=200)
    residuals -= jacobian @ np.linalg.lstsq(jacobian, residuals, rcond=None)[0]  # at an optimum
    z = np.array([end, 0.5, 0.4])[order]
    assert judged(z, jacobian, residuals) == ["", "", ""]


def test_it_is_pressed_where_the_partner_has_no_room_to_follow():
    """The sum should be lower than both bounds allow: both stand at 0 and are pressed; near 0 the partner cannot
    follow."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=200)
    jacobian = np.column_stack([a, a])
    noise = 0.01 * rng.normal(size=200)
    assert judged([0.0, 0.0], jacobian, 0.3 * a + noise) == ["lower", "lower"]
    assert judged([0.0, 0.01], jacobian, noise - a * (a @ noise) / (a @ a)) == ["lower", ""]
    assert judged([1.0, 1.0], jacobian, -0.3 * a + noise) == ["upper", "upper"]


def test_a_coordinate_that_the_data_pull_outside_is_pressed_and_one_without_effect_is_not():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 300))
    jacobian = np.column_stack([a, b, 1e-9 * rng.normal(size=300)])
    noise = 0.05 * rng.normal(size=300)
    assert judged([0.0, 0.5, 0.0], jacobian, 0.4 * a + noise) == ["lower", "", ""]
    # on the other side of its bound: the next step goes inside
    assert judged([0.0, 0.5, 1.0], jacobian, -0.4 * a + noise) == ["", "", ""]


def test_many_coordinates_are_judged_by_those_inside():
    rng = np.random.default_rng(4)
    jacobian = rng.normal(size=(400, 50))
    jacobian[:, 1] = jacobian[:, 0]
    residuals = 0.01 * rng.normal(size=400)
    residuals -= jacobian @ np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
    z = np.full(50, 0.5)
    z[[0, 7]] = 0.0
    found = judged(z, jacobian, residuals + 0.3 * jacobian[:, 7])
    assert found[0] == ""
    assert found[7] == "lower"
