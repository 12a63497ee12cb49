"""Steps of bounded least squares: linear problems at once, bounds, digits, and when an optimum is called one."""

import numpy as np
import pytest
from scipy import optimize

from plantfit.optimize.local.damped_steps import FINISHED, Lanes, Rows


def lanes_of(a, x, target, damping=1e-12):
    """Searches of |A (x - target)|^2; a (n, m, d), x and target (n, d)."""
    r = np.einsum("bij,bj->bi", a, x - target)
    lanes = Lanes.begin(x, Rows(r, a, x), np.ones(len(x), bool), np.zeros(len(x), bool), 100)
    lanes.damping[:] = damping
    return lanes


def test_first_step_solves_a_linear_problem_up_to_its_damping():
    rng = np.random.default_rng(1)
    a, x = rng.normal(size=(5, 30, 4)), rng.uniform(0.4, 0.6, size=(5, 4))
    target = rng.uniform(0.3, 0.7, size=(5, 4))
    lanes = lanes_of(a, x, target)
    step, promised = lanes.propose()
    np.testing.assert_allclose(x + step, target, atol=1e-9)
    np.testing.assert_allclose(promised, lanes.squares, rtol=1e-9)


@pytest.mark.filterwarnings("error")
def test_derivatives_whose_squares_overflow_give_the_step_of_other_units():
    """A model that nearly explodes has derivatives of 1e160."""
    a, r, x = np.random.default_rng(4).normal(size=(1, 20, 2)), np.linspace(-1.0, 0.5, 20)[None], np.full((1, 2), 0.5)
    lanes = Lanes.begin(x, Rows(r, 1e160 * a, x), np.ones(1, bool), np.zeros(1, bool), 100)
    lanes.damping[:] = 1e-12
    wanted = -np.linalg.lstsq(a[0], r[0], rcond=None)[0]
    np.testing.assert_allclose(lanes.propose()[0][0] * 1e160, wanted, rtol=1e-6)


def test_a_step_ends_on_the_bounds_and_solves_for_the_rest():
    rng = np.random.default_rng(2)
    for _ in range(20):
        a, target = rng.normal(size=(12, 3)), np.array([1.4, 0.5, -0.3])
        lanes = lanes_of(a[None], np.full((1, 3), 0.5), target)
        step, promised = lanes.propose()
        free = optimize.lsq_linear(a, a @ target, bounds=(0, 1), method="bvls").x
        on_bounds = (free == 0.0) | (free == 1.0)
        np.testing.assert_array_equal((0.5 + step[0])[on_bounds], free[on_bounds])
        left = a @ (0.5 + step[0] - target)
        assert promised[0] == pytest.approx(lanes.squares[0] - left @ left, rel=1e-9)


@pytest.mark.parametrize("condition", [1e4, 1e7, 1e10])
def test_steps_keep_the_digits_that_normal_equations_lose(condition):
    """Nearly parallel columns: the error of QR grows with the condition number, that of J'J with its square."""
    rng = np.random.default_rng(3)
    q, _ = np.linalg.qr(rng.normal(size=(40, 3)))
    v, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    a = q @ np.diag([1.0, condition**-0.5, 1 / condition]) @ v.T
    x, target = np.full(3, 0.5), np.array([0.31, 0.62, 0.47])
    lanes = lanes_of(a[None], x[None], target, damping=1e-32)
    step, _ = lanes.propose()
    error = np.linalg.norm(x + step[0] - target)
    assert error < 1e-14 * condition
    if condition >= 1e7:
        normal = (
            -np.linalg.solve(a.T @ a + 1e-32 * np.eye(3), a.T @ (a @ (x - target)))
            if condition < 1e8
            else np.full(3, np.inf)
        )
        assert np.linalg.norm(x + normal - target) > 100 * error


def test_promise_is_what_the_whole_linear_problem_gives():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(50, 4)) * [1e-8, 1.0, 1e5, 3.0], rng.normal(size=50)
    x = np.full((1, 4), 0.5)
    lanes = Lanes.begin(x, Rows(b[None], a[None], x), np.ones(1, bool), np.zeros(1, bool), 100)
    best = b + a @ np.linalg.lstsq(a, -b, rcond=None)[0]
    assert lanes.promise()[0] == pytest.approx(b @ b - best @ best, rel=1e-9)
    there = Lanes.begin(x, Rows(best[None], a[None], x), np.ones(1, bool), np.zeros(1, bool), 100)
    assert there.promise()[0] <= FINISHED * there.squares[0]


def test_promise_leaves_out_coordinates_that_a_bound_holds_and_those_without_effect():
    """The optimum of a bounded problem promises nothing more; nor does a plateau whose slope is tiny over the whole
    box."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(30, 6)), 4 * rng.normal(size=30)
    answer = optimize.lsq_linear(a, b, bounds=(0, 1), method="bvls", tol=1e-15)
    assert np.any(answer.active_mask)
    x, r = answer.x[None], (a @ answer.x - b)[None]
    lanes = Lanes.begin(x, Rows(r, a[None], x), np.ones(1, bool), np.zeros(1, bool), 100)
    assert lanes.promise()[0] <= FINISHED * lanes.squares[0]
    r, x = np.ones((1, 30)), np.full((1, 2), 0.5)
    tiny = np.stack([1e-14 * np.ones(30), 1e-16 * np.arange(30)], axis=1)[None]
    assert Lanes.begin(x, Rows(r, tiny, x), np.ones(1, bool), np.zeros(1, bool), 100).promise()[0] == 0.0
    weak = 1e-7 * np.ones((1, 30, 2))
    assert Lanes.begin(x, Rows(r, weak, x), np.ones(1, bool), np.zeros(1, bool), 100).promise()[0] > 1.0
