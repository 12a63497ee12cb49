"""Least squares within bounds: against scipy and against the conditions of an optimum, of any rank and scale."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from plantfit.problem.evaluate.bounded_linear import Orthogonal, solve_within


def problem(seed: int, p: int, spread: float = 1.0, rank: int | None = None):
    """A triangle, a target and a begin; with a large `spread` most answers are outside."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(p + 3, p)) @ np.diag(10.0 ** rng.uniform(-4, 4, p))
    if rank is not None:
        columns = columns[:, :rank] @ rng.normal(size=(rank, p))
    at, best = rng.uniform(size=p), rng.uniform(0.5 - spread, 0.5 + spread, p)
    return columns, columns @ (at - best) + 0.1 * rng.normal(size=p + 3) * np.abs(columns).max(), at


@pytest.mark.parametrize("p", [1, 2, 3, 6, 12, 40])
@pytest.mark.parametrize("spread", [0.3, 1.0, 5.0])
def test_the_cost_is_that_of_scipy(p, spread):
    for seed in range(8):
        columns, r, at = problem(seed, p, spread)
        found = solve_within(columns, r, at)
        expected = lsq_linear(columns, columns @ at - r, (0.0, 1.0), method="bvls", tol=1e-15, max_iter=2000)
        assert np.sum((r + columns @ (found.s - at)) ** 2) <= 2 * expected.cost * (1 + 1e-9)
        assert np.all((found.s >= 0.0) & (found.s <= 1.0))
        assert np.all((found.s[~found.free] == 0.0) | (found.s[~found.free] == 1.0))


@pytest.mark.parametrize("rank", [1, 2, 4])
@pytest.mark.parametrize("spread", [0.2, 3.0])
def test_the_conditions_of_an_optimum_hold_whatever_the_rank(rank, spread):
    for seed in range(10):
        columns, r, at = problem(seed, 6, spread, rank)
        s, free, _ = solve_within(columns, r, at)
        slope = columns.T @ (r + columns @ (s - at)) / np.linalg.norm(columns, axis=0) / np.linalg.norm(r)
        assert np.all(np.abs(slope[free]) < 1e-9)
        assert np.all(slope[s == 0.0] > -1e-9)
        assert np.all(slope[s == 1.0] < 1e-9)
        assert np.all((s >= 0.0) & (s <= 1.0))


def test_what_is_not_seen_goes_to_the_middle_of_the_box():
    column = np.array([[1.0], [2.0]])
    s, free, _ = solve_within(
        np.hstack([column, column, np.zeros((2, 1))]), -column[:, 0] * 0.4, np.array([0.4, 0.4, 0.0])
    )
    np.testing.assert_allclose(s, [0.6, 0.6, 0.5], atol=1e-14)
    assert free.all()


def test_an_answer_on_the_bound_keeps_the_bound_exactly():
    s, free, _ = solve_within(np.eye(2), np.array([0.7, -0.2]), np.array([0.3, 0.3]))
    assert s.tolist() == [0.0, 0.5]
    assert free.tolist() == [False, True]


def test_the_answer_moves_with_the_scale_of_columns_and_the_order():
    columns, r, at = problem(3, 5, 1.0)
    s, free, _ = solve_within(columns, r, at)
    order = np.array([3, 1, 4, 0, 2])
    turned = solve_within(columns[:, order], r, at[order])
    np.testing.assert_allclose(turned.s, s[order], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(turned.free, free[order])
    scaled = solve_within(1e6 * columns, 1e6 * r, at)
    np.testing.assert_allclose(scaled.s, s, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rank", [0, 1, 3, 4])
def test_the_parts_of_a_decomposition_are_what_they_say(rank):
    rng = np.random.default_rng(rank)
    columns = (rng.normal(size=(7, rank)) @ rng.normal(size=(rank, 4))) * np.array([1e-6, 1.0, 1e3, 10.0])
    rows, found = rng.normal(size=(7, 3)), Orthogonal.of(columns)
    assert found.rank == rank
    inverse = np.linalg.pinv(columns / found.scale, rcond=1e-11)
    projector = np.eye(7) - (columns / found.scale) @ inverse
    np.testing.assert_allclose(found.below(rows).T @ found.below(rows), rows.T @ projector @ rows, atol=1e-10)
    np.testing.assert_allclose(found.step(rows[:, 0]), -(inverse @ rows[:, 0]) / found.scale, rtol=1e-8, atol=1e-12)
    m = rng.normal(size=(4, 2))
    np.testing.assert_allclose(
        found.u[:, :rank] @ found.forced(m), inverse.T @ (m / found.scale[:, None]), rtol=1e-8, atol=1e-10
    )
    np.testing.assert_allclose(columns @ found.open(np.ones(4)), 0.0, atol=1e-10)
