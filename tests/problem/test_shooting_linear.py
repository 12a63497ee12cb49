"""The elimination against a dense solution of the same problem."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from plantfit.problem.shooting.elimination import Linear, step


def chain(records=(5, 3), n=2, q=3, d=4, k=6, seed=0, growth=1.0) -> Linear:
    """Random segments of records that share the first q - 1 coordinates; the others belong to one record each."""
    rng = np.random.default_rng(seed)
    count = sum(records)
    record = np.repeat(np.arange(len(records)), records)
    local = np.array([[*range(q - 1), q - 1 + r] for r in record])
    assert np.max(local) == d - 1
    end = rng.normal(size=(count, n, q + n))
    end[:, :, q:] *= growth
    joined = np.append(record[1:] == record[:-1], False)
    return Linear(
        rng.normal(size=(count, k, q + n + 1)), end, rng.normal(size=(count, n)) * joined[:, None], joined, local
    )


def dense(linear: Linear, weight: float, damping: float, z: np.ndarray):
    """The step by one bounded least-squares problem over everything."""
    count, n = linear.gap.shape
    q, d = linear.local.shape[1], len(z)
    total, rows, right = d + count * n, [], []
    for i in range(count):
        for row in linear.rows[i]:
            wide = np.zeros(total)
            wide[linear.local[i]], wide[d + i * n : d + (i + 1) * n] = row[:q], row[q:-1]
            rows.append(wide)
            right.append(-row[-1])
        for j in range(n if linear.joined[i] else 0):
            wide = np.zeros(total)
            wide[linear.local[i]], wide[d + i * n : d + (i + 1) * n] = linear.end[i, j, :q], linear.end[i, j, q:]
            wide[d + (i + 1) * n + j] = -1.0
            rows.append(wide * weight / np.sqrt(linear.nodes))
            right.append(-linear.gap[i, j] * weight / np.sqrt(linear.nodes))
    soft = np.eye(total)[d:] * np.sqrt(damping / linear.nodes)
    matrix, right = np.vstack([*rows, soft]), np.r_[right, np.zeros(count * n)]
    basis = np.linalg.qr(matrix[:, d:])[0]
    sizes = np.linalg.norm(matrix[:, :d] - basis @ (basis.T @ matrix[:, :d]), axis=0)  # what the states cannot explain
    assert np.all(sizes > 1e-3)
    matrix, right = np.vstack([matrix, np.sqrt(damping) * np.diag(sizes) @ np.eye(d, total)]), np.r_[right, np.zeros(d)]
    low, high = np.r_[-z, np.full(count * n, -np.inf)], np.r_[1 - z, np.full(count * n, np.inf)]
    answer = lsq_linear(matrix, right, (low, high), method="bvls", tol=1e-14)
    return answer.x[:d], answer.x[d:].reshape(count, n)


@pytest.mark.parametrize("weight", [0.1, 1.0, 100.0])
@pytest.mark.parametrize("damping", [1e-6, 1.0])
def test_equals_the_dense_solution(weight, damping):
    z = np.array([0.3, 0.0, 1.0, 0.9])
    for seed in range(4):
        linear = chain(seed=seed)
        for got, wanted in zip(step(linear, weight, damping, z), dense(linear, weight, damping, z), strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-7, atol=1e-9)


def test_bounds_bind_in_these_examples():
    z = np.array([0.3, 0.0, 1.0, 0.9])
    moved = np.array([z + step(chain(seed=s), 1.0, 1e-6, z)[0] for s in range(4)])
    assert np.all((moved >= 0.0) & (moved <= 1.0))
    assert np.any((moved == 0.0) | (moved == 1.0))


def test_held_coordinates_stay_and_the_states_solve_what_is_left():
    linear, z = chain(), np.full(4, 0.5)
    dz, ds = step(linear, 1.0, 1e-9, z, held=True)
    assert np.all(dz == 0.0)
    best = linear.merit(1.0, dz, ds)
    rng = np.random.default_rng(1)
    assert all(linear.merit(1.0, dz, ds + 0.01 * rng.normal(size=ds.shape)) > best for _ in range(20))


def test_the_order_of_coordinates_and_of_records_does_not_matter():
    linear, z = chain(), np.array([0.3, 0.2, 0.6, 0.9])
    dz, ds = step(linear, 3.0, 1e-6, z)
    order = np.r_[5:8, 0:5]
    swapped = Linear(*(a[order] for a in linear))
    np.testing.assert_allclose(step(swapped, 3.0, 1e-6, z)[0], dz, rtol=1e-8)
    np.testing.assert_allclose(step(swapped, 3.0, 1e-6, z)[1], ds[order], rtol=1e-7, atol=1e-10)
    place = np.array([2, 0, 3, 1])  # coordinate i is now called place[i]
    renamed = linear._replace(local=place[linear.local])
    there = np.empty(4)
    there[place] = z
    np.testing.assert_allclose(step(renamed, 3.0, 1e-6, there)[0][place], dz, rtol=1e-8)


def test_no_digits_are_lost_when_states_grow_without_bound():
    """Eighty segments that each grow by 20: a forward recursion would multiply rounding by 1e104."""
    linear = chain(records=(80,), d=3, growth=20.0)
    z = np.full(3, 0.5)
    dz, ds = step(linear, 1e4, 1e-9, z)
    wanted = dense(linear, 1e4, 1e-9, z)
    np.testing.assert_allclose(dz, wanted[0], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(ds, wanted[1], rtol=1e-5, atol=1e-8)
    gap = (
        linear.gap
        + np.einsum("lnv,lv->ln", linear.end, np.concatenate([dz[linear.local], ds], axis=1))
        - np.roll(ds, -1, axis=0)
    )
    assert np.max(np.abs(gap[:-1])) < 1e-4
