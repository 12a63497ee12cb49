"""Combinations of physical parameters: rank, formulas, and exact curves along which nothing changes."""

import numpy as np
import pytest

from plantfit.errors import ModelError
from plantfit.models.library.pendubot import pendubot_regression
from plantfit.models.library.pendubot_terms import base_values
from plantfit.trust import combinations, flat_curves

NAMES = ("m1", "m2", "lc1", "lc2", "I1", "I2")
LOWER, UPPER = np.array([0.001, 0.001, 0.001, 0.001, 1e-4, 1e-4]), np.array([0.4, 0.4, 0.15, 0.3, 1e-3, 1e-3])
TRUTH = np.array([0.21, 0.1, 0.12, 0.15, 0.00053, 0.00077])
CONSTANTS = {"l1": 0.15, "l2": 0.3, "g": 9.81}
FORMULAS = ("b1 = m1*lc1^2 + l1^2*m2 + I1", "b2 = m2*lc2^2 + I2", "b4 = m1*lc1 + l1*m2", "b5 = m2*lc2")


@pytest.fixture(scope="module")
def pendubot():
    return combinations(base_values, NAMES, LOWER, UPPER, ("b1", "b2", "b4", "b5"), constants=CONSTANTS)


def test_the_pendubot_tells_four_combinations_of_six(pendubot):
    assert pendubot.rank == 4
    assert np.all(pendubot.rank_at == 4)
    assert pendubot.texts == FORMULAS
    assert pendubot.sentence == (
        f"4 combinations of the 6 parameters are determined: {', '.join(FORMULAS)}; the other 2 directions are flat."
    )


def test_a_coefficient_that_repeats_another_adds_nothing(pendubot):
    def with_b3(p):
        b = base_values(p)
        return {"b1": b["b1"], "b2": b["b2"], "b3": 0.15 * b["b5"], "b4": b["b4"], "b5": b["b5"]}

    found = combinations(with_b3, NAMES, LOWER, UPPER, ("b1", "b2", "b3", "b4", "b5"), constants=CONSTANTS)
    assert found.texts == FORMULAS


def test_a_record_at_rest_tells_less_than_one_in_motion():
    rng = np.random.default_rng(0)
    model, n = pendubot_regression(), 300
    moving = {s: rng.uniform(-1, 1, n) for s in model.signals}
    still = {s: moving[s] if s.startswith("theta") else np.zeros(n) for s in moving}
    ranks = {}
    for name, signals in (("moving", moving), ("still", still)):
        found = combinations(
            base_values, NAMES, LOWER, UPPER, tuple(model.coefficients), model.columns(signals), CONSTANTS
        )
        ranks[name] = found.rank, found.texts
    assert ranks["moving"] == (4, FORMULAS)
    assert ranks["still"] == (2, FORMULAS[2:])


def test_order_and_units_of_the_parameters_do_not_matter(pendubot):
    order = [3, 5, 0, 2, 4, 1]
    scale = np.array([1e3, 1e-3, 1e2, 1e3, 1e7, 1.0])  # other units

    def base(p):
        return base_values({n: p[n] / s for n, s in zip(NAMES, scale, strict=True)})

    found = combinations(base, [NAMES[i] for i in order], (LOWER * scale)[order], (UPPER * scale)[order])
    assert found.rank == 4
    point = (TRUTH * scale)[order]
    both = np.vstack([(found.jacobian(point) * point)[:, np.argsort(order)], pendubot.jacobian(TRUTH) * TRUTH])
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(both, tol=1e-9) == 4


def test_flat_curves_keep_the_torque_and_reach_the_box(pendubot):
    rng = np.random.default_rng(1)
    model = pendubot_regression()
    columns = model.columns({s: rng.uniform(-2, 2, 400) for s in model.signals})
    torque = columns @ np.array(model.coefficient_values(dict(zip(NAMES, TRUTH, strict=True))))
    curves = flat_curves(pendubot, TRUTH)
    assert [c.moving for c in curves] == [("m1", "lc1", "I1"), ("m1", "m2", "lc1", "lc2", "I2")]
    for curve in curves:
        np.testing.assert_allclose(curve.points[curve.at], TRUTH)
        for point in curve.points[::10]:
            same = columns @ np.array(model.coefficient_values(dict(zip(NAMES, point, strict=True))))
            np.testing.assert_allclose(same, torque, rtol=0, atol=1e-12 * np.max(np.abs(torque)))
        for end in (curve.points[0], curve.points[-1]):
            cube = (end - LOWER) / (UPPER - LOWER)
            assert min(cube.min(), (1 - cube).min()) < 1e-5  # a bound is met
            assert np.all((cube >= 0) & (cube <= 1))
        assert np.max(np.abs(curve.points / TRUTH - 1)) > 0.2  # and it is a long way


def test_the_first_flat_curve_agrees_with_its_closed_form(pendubot):
    # m1 lc1 = h and m1 lc1^2 + I1 = J: lc1 = h / m1, I1 = J - h^2 / m1
    curve = flat_curves(pendubot, TRUTH)[0]
    m1, lc1, inertia = curve.points[:, 0], curve.points[:, 2], curve.points[:, 4]
    h, j = 0.21 * 0.12, 0.21 * 0.12**2 + 0.00053
    np.testing.assert_allclose(lc1, h / m1, rtol=1e-12)
    np.testing.assert_allclose(inertia, j - h**2 / m1, rtol=1e-10)


def test_a_product_of_two_is_one_combination_with_a_hyperbola():
    found = combinations(lambda p: [p["a"] * p["b"], p["c"]], "abc", [0.1, 0.1, 0.1], [2.0, 2.0, 2.0])
    assert (
        found.sentence
        == "2 combinations of the 3 parameters are determined: b1 = a*b, b2 = c; the other direction is flat."
    )
    (curve,) = flat_curves(found, np.array([1.0, 0.5, 1.0]))
    np.testing.assert_allclose(curve.points[:, 0] * curve.points[:, 1], 0.5, rtol=1e-13)
    assert "a and b can move together" in curve.sentence


def test_determined_parameters_have_no_flat_curve():
    found = combinations(lambda p: [p["a"], p["a"] * p["b"]], "ab", [0.1, 0.1], [1.0, 1.0])
    assert found.sentence == "All 2 parameters are determined: a and b."
    assert flat_curves(found, np.array([0.5, 0.5])) == ()


def test_a_map_that_is_no_polynomial_keeps_its_label():
    found = combinations(lambda p: [p["a"] / p["b"]], "ab", [0.1, 0.1], [1.0, 1.0], ["ratio"])
    assert found.texts == ("ratio",)


def test_wrong_input_is_told_in_a_sentence(pendubot):
    with pytest.raises(ModelError, match="m1 = 1 lies outside its bounds"):
        flat_curves(pendubot, np.r_[1.0, TRUTH[1:]])
    with pytest.raises(ModelError, match="gives 4 coefficients, but 2 names"):
        combinations(base_values, NAMES, LOWER, UPPER, ("b1", "b2"))
    with pytest.raises(ModelError, match="give a lower below an upper"):
        combinations(base_values, NAMES, UPPER, LOWER)
    with pytest.raises(ModelError, match="not finite"):
        combinations(lambda p: [np.nan * p["a"]], "a", [0.0], [1.0])
