"""Square roots of covariances against numpy and scipy."""

import numpy as np
import pytest
from scipy.linalg import expm

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.square_root import cholesky, sampled_noise_root, triangular, whitened

import jax


@pytest.mark.parametrize(("m", "k"), [(1, 1), (6, 9), (5, 3)])
def test_triangular_keeps_the_product_of_rows(m, k):
    rows = np.random.default_rng(m).standard_normal((m, k)) * 10.0 ** np.arange(m)[:, None]
    lower = np.asarray(jax.jit(triangular)(rows))
    assert np.array_equal(lower, np.tril(lower))
    scale = np.linalg.norm(rows, axis=1)
    assert np.max(np.abs(lower @ lower.T - rows @ rows.T) / np.outer(scale, scale)) < 1e-14


def test_rows_that_say_nothing_new_leave_zeros():
    rows = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    lower = np.asarray(jax.jit(triangular)(rows))
    assert lower[1, 1] == lower[2, 2] == 0.0
    assert np.allclose(lower @ lower.T, rows @ rows.T, atol=1e-14)
    assert np.all(np.isfinite(jax.jit(jax.jacfwd(triangular))(rows)))


def test_cholesky_and_whitening_agree_with_numpy():
    a = np.random.default_rng(2).standard_normal((4, 6))
    spd = a @ a.T
    assert np.allclose(cholesky(spd), np.linalg.cholesky(spd), rtol=1e-12)
    v = np.arange(4.0)
    assert np.allclose(whitened(np.linalg.cholesky(spd), v), np.linalg.solve(np.linalg.cholesky(spd), v))
    half = np.diag([4.0, 0.0, 9.0])
    assert np.array_equal(cholesky(half), np.diag([2.0, 0.0, 3.0]))


@pytest.mark.parametrize("h", [1e-6, 1e-3, 0.05])
def test_sampled_noise_is_van_loans(h):
    # a motor: eigenvalues near -240 and -1200 1/s, entries from 0.4 to 2e5
    a, intensity = np.array([[-246.7, -0.4477], [2.2018e5, -49.8]]), np.array([1.0, 300.0])
    big = expm(h * np.block([[-a, np.diag(intensity**2)], [np.zeros((2, 2)), a.T]])) if h < 0.01 else None
    lower = np.asarray(sampled_noise_root(a, intensity, h))
    if big is not None:
        want = big[2:, 2:].T @ big[:2, 2:]
    else:  # exp(-a h) overflows the digits there; the stationary covariance less what is left of it is exact
        from scipy.linalg import solve_continuous_lyapunov

        full = solve_continuous_lyapunov(a, -np.diag(intensity**2))
        want = full - expm(a * h) @ full @ expm(a.T * h)
    scale = np.sqrt(np.diag(want))
    assert np.max(np.abs(lower @ lower.T - want) / np.outer(scale, scale)) < 1e-9


def test_noise_of_a_chain_of_integrators_is_the_closed_form():
    h = 0.3
    lower = np.asarray(sampled_noise_root(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 2.0]), h))
    assert np.allclose(lower @ lower.T, 4.0 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]), rtol=1e-12)


def test_no_noise_and_no_time_add_nothing():
    a = np.array([[0.0, 1.0], [-3.0, -0.5]])
    assert np.all(np.asarray(sampled_noise_root(a, np.zeros(2), 0.1)) == 0.0)
    assert np.all(np.asarray(sampled_noise_root(a, np.ones(2), 0.0)) == 0.0)
