"""Base parameters: known ranks and formulas, whatever the scale or order of the parameters."""

import numpy as np
import pytest

from plantfit.errors import ModelError
from plantfit.trust import base_parameters
from plantfit.trust.identify.formulas import factor_text, polynomial, polynomial_text, sum_text

L1, G = 0.15, 9.81
CONSTANTS = {"l1": L1, "l2": 0.3, "g": G}
NAMES = ("J1", "h1", "m2", "h2", "J2")  # inertias about the joints, first moments, mass of link 2


def arm_torque_columns(seed, n=500):
    """Torque of joint 1 of a two-link arm by its standard inertial parameters, written from Newton and Euler's
    equations."""
    t1, t2, w1, w2, a1, a2 = np.random.default_rng(seed).uniform(-2.0, 2.0, (6, n))
    coupled = L1 * ((2 * a1 + a2) * np.cos(t2) - (2 * w1 * w2 + w2**2) * np.sin(t2)) + G * np.cos(t1 + t2)
    return np.c_[a1, G * np.cos(t1), L1**2 * a1 + G * L1 * np.cos(t1), coupled, a1 + a2]


def test_the_two_link_arm_has_four_base_parameters_with_the_textbook_names():
    found = base_parameters(arm_torque_columns(0), NAMES, CONSTANTS)
    assert found.rank == 4
    assert found.texts == ("J1 + l1^2*m2", "h1 + l1*m2", "h2", "J2")
    assert found.sentence == "4 combinations of the 5 parameters are determined: J1 + l1^2*m2, h1 + l1*m2, h2, J2."


def test_base_parameters_predict_what_all_parameters_do():
    w, x = arm_torque_columns(1), np.random.default_rng(1).uniform(0.1, 1.0, 5)
    found = base_parameters(w, NAMES)
    np.testing.assert_allclose(w[:, found.columns] @ (found.regrouping @ x), w @ x, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_scales_and_order_do_not_change_what_is_determined(seed):
    rng = np.random.default_rng(seed)
    w, order, scale = arm_torque_columns(seed), rng.permutation(5), 10.0 ** rng.uniform(-6, 6, 5)
    plain = base_parameters(w, NAMES)
    other = base_parameters((w * scale)[:, order], [NAMES[i] for i in order])
    assert other.rank == plain.rank == 4
    back = np.zeros((4, 5))
    back[:, order] = other.regrouping  # by the parameters x / scale
    both = np.vstack([plain.regrouping, back / scale])
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(both, tol=1e-8) == 4  # both span the same combinations


@pytest.mark.parametrize(("k", "rank"), [(3, 1), (6, 2), (8, 5), (4, 4)])
def test_ranks_of_products_are_found(k, rank):
    rng = np.random.default_rng(k)
    w = rng.normal(size=(200, rank)) @ rng.normal(size=(rank, k))
    found = base_parameters(w, [f"p{i}" for i in range(k)])
    assert found.rank == rank
    np.testing.assert_allclose(w[:, found.columns] @ found.regrouping, w, atol=1e-9)


def test_the_triangle_of_a_regressor_is_worth_the_regressor():
    w = arm_torque_columns(2)
    assert base_parameters(np.linalg.qr(w)[1], NAMES, CONSTANTS).texts == base_parameters(w, NAMES, CONSTANTS).texts


def test_a_parameter_without_effect_is_told():
    w = np.c_[arm_torque_columns(3), np.zeros(500)]
    found = base_parameters(w, (*NAMES, "m1"))
    assert found.unseen == ("m1",)
    assert found.sentence.endswith("m1 has no effect.")
    assert np.all(found.regrouping[:, 5] == 0.0)


def test_a_dependence_up_to_noise_needs_its_tolerance():
    rng = np.random.default_rng(4)
    a = rng.normal(size=(1000, 2))
    w = np.c_[a, a @ [1.0, -2.0] + 1e-4 * rng.normal(size=1000)]
    assert base_parameters(w, "abc").rank == 3
    loose = base_parameters(w, "abc", tolerance=1e-3)
    assert loose.rank == 2
    np.testing.assert_allclose(loose.regrouping, [[1, 0, 1.0], [0, 1, -2.0]], atol=1e-2)


def test_wrong_input_is_told_in_a_sentence():
    with pytest.raises(ModelError, match=r"shape \(4, 2\) for 3 parameters"):
        base_parameters(np.ones((4, 2)), "abc")
    with pytest.raises(ModelError, match="row 1, column 'b'"):
        base_parameters([[1.0, 2.0], [1.0, np.nan]], "ab")


FACTORS = {
    1.0: "",
    L1: "l1",
    L1**2: "l1^2",
    2 * L1**2: "l1*l2",
    G * L1: "l1*g",
    1 / G: "1/g",
    0.0437: "0.0437",
    3.0: "3",
}


@pytest.mark.parametrize(("value", "text"), FACTORS.items())
def test_factors_are_named_by_constants(value, text):
    assert factor_text(value, CONSTANTS) == text


def test_sums_carry_their_signs():
    assert sum_text([(-1.0, "a"), (0.15, "b"), (-0.5, "c")], {"l1": 0.15}) == "-a + l1*b - 1/2*c"


def test_polynomials_are_found_by_evaluation_alone():
    lower, upper = np.array([0.001, 0.001, 1e-4]), np.array([0.4, 0.15, 1e-3])
    terms = polynomial(lambda p: p[:, 0] * p[:, 1] ** 2 + 0.3 * p[:, 2] - 2.0, lower, upper)
    assert terms is not None
    assert polynomial_text(terms, "mlI", CONSTANTS) == "m*l^2 + l2*I - 2"
    assert polynomial(lambda p: np.sqrt(np.abs(p[:, 0])), lower, upper) is None
    assert polynomial(lambda p: p[:, 0] / p[:, 1], lower, upper) is None
