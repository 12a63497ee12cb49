"""Many rows in few, against numpy."""

import numpy as np
import pytest

from plantfit.problem.evaluate import triangle as module
from plantfit.problem.evaluate.triangle import ROWS, triangle
from plantfit.study import objective

SHAPES = [
    (3, 7),
    (7, 3),
    (ROWS, 5),
    (2 * ROWS + 1, 1),
    (2 * ROWS + 1, 12),
    (5000, 32),
    (3000, 64),
    (1000, 90),
    (600, 0),
]


@pytest.mark.parametrize("shape", SHAPES)
def test_it_keeps_all_products(shape):
    rows = np.random.default_rng(1).normal(size=shape) * 10.0 ** np.linspace(-6, 6, shape[1])
    found = triangle(rows)
    assert found.shape == (min(shape), shape[1])
    assert np.array_equal(found, np.triu(found))
    scale = np.sqrt(np.sum(rows**2, axis=0))
    np.testing.assert_allclose(
        found.T @ found / np.outer(scale, scale), rows.T @ rows / np.outer(scale, scale), atol=1e-13
    )


def test_it_equals_the_triangle_of_numpy_row_by_row():
    rows = np.random.default_rng(2).normal(size=(4000, 20))
    ours, theirs = triangle(rows), np.linalg.qr(rows, mode="r")
    signs = np.sign(np.diag(ours) * np.diag(theirs))
    np.testing.assert_allclose(ours, signs[:, None] * theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())


def test_nearly_dependent_columns_keep_their_difference():
    rng = np.random.default_rng(3)
    base, little = rng.normal(size=2000), rng.normal(size=2000)
    rows = np.column_stack([base, base + 1e-9 * little])
    _, r = np.linalg.qr(rows)
    assert abs(triangle(rows)[1, 1]) == pytest.approx(abs(r[1, 1]), rel=1e-6)  # its square would be lost in rows'rows


@pytest.mark.parametrize("shape", [(50, 4), (3000, 4)])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_not_finite_gives_nan_everywhere(shape, bad):
    rows = np.ones(shape)
    rows[-1, -1] = bad
    assert np.all(np.isnan(triangle(rows)))


@pytest.mark.parametrize("shape", [(50, 4), (3000, 4)])
def test_columns_of_zeros_and_of_tiny_numbers(shape):
    rows = np.random.default_rng(4).normal(size=shape)
    rows[:, 1], rows[:, 3] = 0.0, 1e-310
    found = triangle(rows)
    np.testing.assert_array_equal(found[:, [1, 3]], 0.0)
    np.testing.assert_allclose(
        found.T @ found,
        np.where(np.abs(rows) < 1e-200, 0, rows).T @ np.where(np.abs(rows) < 1e-200, 0, rows),
        atol=1e-10,
    )


@pytest.mark.parametrize("m", [ROWS, 5 * ROWS + 17])
def test_a_column_beside_has_the_bits_of_one_among_the_others(m):
    rng = np.random.default_rng(4)
    rows, beside = rng.normal(size=(m, 6)) * 10.0 ** rng.integers(-210, 3, size=(m, 6)), rng.normal(size=m)
    assert np.array_equal(triangle(rows, beside), triangle(np.column_stack([rows, beside])))


def test_a_point_that_fills_up_a_batch_has_the_rows_of_the_first_without_a_decomposition(monkeypatch):
    rng, decomposed = np.random.default_rng(1), []

    def counted(*pair):
        decomposed.append(pair)
        return module.triangle(*pair)

    monkeypatch.setattr(objective, "triangle", counted)
    zs, r, jacobian = rng.random((3, 4)), rng.normal(size=(3, 50)), rng.normal(size=(3, 50, 4))
    filled = [0, 1, 2, 0, 0]
    few, slopes = objective._in_few_rows(zs[filled], r[filled], jacobian[filled])
    assert len(decomposed) == 3
    for k, i in enumerate(filled):
        whole = np.sqrt(5 / 50) * triangle(jacobian[i], r[i])
        assert np.array_equal(few[k], whole[:, 4])
        assert np.array_equal(slopes[k], whole[:, :4])
