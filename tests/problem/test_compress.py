"""The compressed regression against every sample, for any rank, size and scale."""

import numpy as np
import pytest

from plantfit.errors import RecordingError
from plantfit.problem.evaluate import compress as room
from plantfit.problem.evaluate.compress import compress, mean_square

import jax
import jax.numpy as jnp


def data(rows=400, columns=4, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)), rng.normal(size=rows), rng.normal(size=(9, columns))


def direct(regressor, target, base):
    return np.mean((base @ regressor.T - target) ** 2, axis=-1)


@pytest.mark.parametrize(("rows", "columns"), [(400, 4), (1, 1), (3, 5), (5, 5), (6, 5), (2, 1)])
def test_equals_the_mean_over_all_samples(rows, columns):
    regressor, target, base = data(rows, columns)
    np.testing.assert_allclose(
        mean_square(compress(regressor, target), base), direct(regressor, target, base), rtol=1e-12
    )


def test_holds_for_any_rank():
    regressor, target, base = data()
    regressor[:, 2] = 3.0 * regressor[:, 0] - regressor[:, 1]
    regressor[:, 3] = 0.0
    compressed = compress(regressor, target)
    np.testing.assert_allclose(mean_square(compressed, base), direct(regressor, target, base), rtol=1e-12)
    small = np.linalg.lstsq(compressed.R, compressed.projected, rcond=1e-10)[0]
    np.testing.assert_allclose(small, np.linalg.lstsq(regressor, target, rcond=1e-10)[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-12, 1e9])
def test_columns_of_very_different_size_keep_their_digits(scale):
    regressor, target, base = data()
    sizes = np.array([1.0, scale, 1.0, 1.0 / scale])
    found = mean_square(compress(regressor * sizes, target), base / sizes)
    np.testing.assert_allclose(found, direct(regressor, target, base), rtol=1e-12)


def test_small_residuals_are_not_lost_beside_large_signals():
    regressor, noise, _ = data()
    base = np.array([3e3, -2e3, 1e3, 5e2])
    compressed = compress(regressor, regressor @ base + 1e-6 * noise)
    assert float(mean_square(compressed, base)) == pytest.approx(1e-12 * np.mean(noise**2), rel=1e-4)


def test_the_order_of_samples_and_blocks_does_not_matter(monkeypatch):
    regressor, target, base = data()
    whole = mean_square(compress(regressor, target), base)
    order = np.random.default_rng(1).permutation(len(target))
    monkeypatch.setattr(room, "BLOCK", 37)
    np.testing.assert_allclose(mean_square(compress(regressor[order], target[order]), base), whole, rtol=1e-12)


def test_traces_batches_and_differentiates():
    regressor, target, base = data()
    compressed = compress(regressor, target)
    gradient = jax.jit(jax.grad(lambda b: mean_square(compressed, b)))(base[0])
    np.testing.assert_allclose(gradient, 2 * regressor.T @ (regressor @ base[0] - target) / len(target), rtol=1e-10)
    assert mean_square(compressed, jnp.ones((2, 3, 4))).shape == (2, 3)
    one_by_one = [float(mean_square(compressed, b)) for b in base]
    np.testing.assert_allclose(mean_square(compressed, base), one_by_one, rtol=1e-14)


@pytest.mark.parametrize(
    ("regressor", "target", "words"),
    [
        (np.ones(5), np.ones(5), "shape"),
        (np.ones((5, 2)), np.ones(4), "shape"),
        (np.ones((5, 0)), np.ones(5), "shape"),
        (np.ones((0, 2)), np.ones(0), "no samples"),
        (np.array([[1.0], [np.nan]]), np.ones(2), "sample 1"),
        (np.ones((3, 1)), np.array([1.0, 2.0, np.inf]), "sample 2"),
    ],
)
def test_bad_input_is_named(regressor, target, words):
    with pytest.raises(RecordingError, match=words):
        compress(regressor, target)
