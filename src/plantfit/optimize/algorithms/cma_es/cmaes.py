"""CMA-ES: full covariance with active update."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.evolution_strategy import EvolutionStrategy, Ranked, Search
from plantfit.optimize.algorithms.cma_es.learning_rates import full_rates, period
from plantfit.optimize.contract import Facts

import jax.numpy as jnp
from jax import Array


class Full(NamedTuple):
    """C, its path, and its eigenvectors in columns, roots of its eigenvalues and symmetric root at the last refresh."""

    cov: Array
    path: Array
    axes: Array
    lengths: Array
    root: Array


@dataclass(frozen=True)
class CmaEs(EvolutionStrategy):
    """(mu/mu_w, lambda)-CMA-ES with negative weights (Hansen 2016, The CMA Evolution Strategy: A Tutorial,
    arXiv:1604.00772, algorithm of fig. 6).

    Candidates outside the cube are evaluated at the nearest point inside and pay an adaptive penalty; the update
    uses the point outside (Hansen, Niederberger, Guzzella and Koumoutsakos 2009, IEEE TEC 13:180). Candidates that
    cannot be simulated have no weight. When its own stop rules hold, the search restarts from a new uniform mean
    with the same population (shapes are fixed), and ends as converged when its restarts are used up. Every second
    search folds candidates back at the bounds instead: it is slower where the optimum is on a bound, and finds narrow
    basins in the inside more often, because wide first steps are not spent on the bounds (docs/bbob.md).
    """

    def refresh_period(self, facts: Facts) -> int:
        return period(full_rates(self.rows(facts), facts.dimension), facts.dimension)

    def refresh(self, state: Search) -> Search:
        values, axes = jnp.linalg.eigh(state.shape.cov)
        lengths = jnp.sqrt(jnp.maximum(values, 1e-300))
        return state._replace(shape=state.shape._replace(axes=axes, lengths=lengths, root=(axes * lengths) @ axes.T))

    def fresh_shape(self, n: int) -> Full:
        eye = jnp.eye(n)
        return Full(eye, jnp.zeros(n), eye, jnp.ones(n), eye)

    def stretch(self, shape: Full, z: Array) -> Array:
        return z @ shape.root

    def whiten(self, shape: Full, y: Array) -> Array:
        return ((y @ shape.axes) / shape.lengths) @ shape.axes.T

    def variances(self, shape: Full) -> Array:
        return jnp.diag(shape.cov)

    def lengths(self, shape: Full) -> Array:
        return shape.lengths

    def axis(self, shape: Full, k: Array) -> Array:
        return shape.lengths[k] * shape.axes[:, k]

    def learn(self, shape: Full, ranked: Ranked) -> Full:
        """Path and covariance: eq. 45-47."""
        r = full_rates(*ranked.y.shape)
        path = (1 - r.c_c) * shape.path + ranked.h * math.sqrt(r.c_c * (2 - r.c_c) * ranked.mu_eff) * ranked.step
        w = jnp.where(ranked.usable, jnp.asarray(r.w), 0.0)
        keep = 1 + r.c_1 * (1 - ranked.h) * r.c_c * (2 - r.c_c) - r.c_1 - r.c_mu * jnp.sum(w)
        cov = keep * shape.cov + r.c_1 * jnp.outer(path, path) + r.c_mu * (ranked.y.T * ranked.weighted(r.w)) @ ranked.y
        return shape._replace(cov=(cov + cov.T) / 2, path=path)
