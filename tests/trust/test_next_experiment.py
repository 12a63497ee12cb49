"""D-optimal designs: against designs known in closed form, within limits, and by Monte Carlo."""

import numpy as np
import pytest

from plantfit.errors import SearchError
from plantfit.trust.experiment.d_optimal import d_optimal, gain

import jax.numpy as jnp


def parabola(design):
    """Information of measurements of a + b x + c x^2 at places `design` with unit noise."""
    columns = jnp.stack([jnp.ones_like(design), design, design**2], axis=1)
    return columns.T @ columns


def free(design):
    return jnp.zeros(1)


@pytest.mark.thorough
def test_a_parabola_is_measured_at_both_ends_and_the_middle():
    # Fedorov 1972, section 2.3: weights 1/3 at -1, 0 and 1
    found = d_optimal(parabola, free, (-np.ones(6), np.ones(6)), budget=3000, seed=1)
    np.testing.assert_allclose(np.sort(found.design), [-1, -1, 0, 0, 1, 1], atol=2e-3)
    best = np.linalg.slogdet(np.asarray(parabola(jnp.array([-1.0, -1, 0, 0, 1, 1]))))[1]
    assert found.log_det == pytest.approx(best, abs=1e-4)
    assert found.violation == 0.0


def test_limits_are_kept_where_they_press():
    # a slope is best measured at the ends; with sum |x| <= 1 the best is |x| = 0.5 each
    def line(design):
        columns = jnp.stack([jnp.ones_like(design), design], axis=1)
        return columns.T @ columns

    found = d_optimal(line, lambda d: jnp.sum(jnp.abs(d)) - 1.0, (-np.ones(2), np.ones(2)), budget=2000)
    assert found.violation == 0.0
    assert found.log_det == pytest.approx(0.0, abs=1e-3)  # det = (x1 - x2)^2 <= 1
    assert np.sum(np.abs(found.design)) <= 1.0


def test_another_optimizer_finds_the_same():
    found = d_optimal(parabola, free, (-np.ones(3), np.ones(3)), method="pso", budget=4000)
    np.testing.assert_allclose(np.sort(found.design), [-1, 0, 1], atol=0.02)


def test_units_of_the_parameters_do_not_matter():
    scale = np.array([1.0, 1e-6, 1e5])
    found = d_optimal(
        lambda d: parabola(d) * np.outer(scale, scale), free, (-np.ones(3), np.ones(3)), budget=1500, seed=2
    )
    np.testing.assert_allclose(np.sort(found.design), [-1, 0, 1], atol=0.02)
    plain = np.linalg.slogdet(np.asarray(parabola(jnp.asarray(found.design))))[1]
    assert found.log_det - plain == pytest.approx(2 * np.sum(np.log(scale)), abs=1e-6)


def test_the_gain_is_what_monte_carlo_finds():
    good, bad = np.array([-1.0, -1, 0, 0, 1, 1]), np.array([-0.5, -0.2, 0.1, 0.3, 0.6, 1.0])
    told = gain("abc", parabola(jnp.asarray(good)), parabola(jnp.asarray(bad)))
    rng, errors = np.random.default_rng(0), []
    for design in (good, bad):
        columns = np.c_[np.ones(6), design, design**2]
        errors.append(np.std(np.linalg.lstsq(columns, rng.normal(size=(6, 4000)))[0], axis=1))
    np.testing.assert_allclose(told.error_ratio, errors[0] / errors[1], rtol=0.06)
    assert told.log_det > 0
    assert "grows by" in told.sentence


def test_what_cannot_be_is_told_in_a_sentence():
    with pytest.raises(SearchError, match="No design keeps all limits: the best of 60 breaks limits by"):
        d_optimal(parabola, lambda d: 1.0 + d**2, (-np.ones(3), np.ones(3)), budget=60)
    with pytest.raises(SearchError, match="give a lower below an upper"):
        d_optimal(parabola, free, (np.ones(3), np.ones(3)))
    with pytest.raises(SearchError, match="give 3 numbers inside"):
        d_optimal(parabola, free, (-np.ones(3), np.ones(3)), start=[2.0, 0.0, 0.0])
    with pytest.raises(SearchError, match="old experiment is singular"):
        gain("ab", np.eye(2), np.ones((2, 2)))
