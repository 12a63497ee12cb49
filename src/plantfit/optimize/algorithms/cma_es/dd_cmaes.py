"""CMA-ES with diagonal decoding: scales learned fast, correlations learned slowly, for hundreds of parameters."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.evolution_strategy import EvolutionStrategy, Ranked, Search
from plantfit.optimize.algorithms.cma_es.learning_rates import Rates, decoding_rates, period
from plantfit.optimize.contract import Facts
from plantfit.optimize.settings import choice

import jax.numpy as jnp
from jax import Array

FREE = 2.0  # beta_thresh: ratio of axes of the correlations up to which the scales learn at full speed
LARGEST_STEP = 0.75  # of an eigenvalue, towards 0, in one refresh


class Decoded(NamedTuple):
    """C = D R D: scales D (d,); correlations R with symmetric root, inverse root and roots of eigenvalues at the last
    refresh; `pending` collects the update of R since then, in whitened coordinates; paths and their weights."""

    scales: Array
    correlations: Array
    root: Array
    inverse: Array
    roots: Array
    pending: Array
    path: Array
    path_weight: Array
    scale_path: Array
    scale_weight: Array

    @property
    def cov(self) -> Array:
        return self.scales[:, None] * self.correlations * self.scales


@dataclass(frozen=True)
class DecodingCmaEs(EvolutionStrategy):
    """dd-CMA-ES (Akimoto and Hansen 2020, Diagonal Acceleration for Covariance Matrix Adaptation Evolution Strategies,
    Evolutionary Computation 28:405).

    C = D R D with a diagonal D that learns at the rate of a separable strategy and a matrix R that learns at the rate
    of a full one; D slows down where R is far from the identity. Restarts, warm starts and failures as in CmaEs.

    Chosen for large problems among full, separable and VkD CMA-ES on 310 parameters: as fast as the separable one where
    scales are all there is to learn, near the full one where directions matter.
    """

    bounds: str = choice("mirror", ("mirror", "penalty"), "at a bound: fold back, or clip and pay for the distance")

    def refresh_period(self, facts: Facts) -> int:
        return period(_matrix_rates(self.rows(facts), facts.dimension), facts.dimension)

    def refresh(self, state: Search) -> Search:
        """R takes up what was collected, becomes a correlation matrix again, and D takes its diagonal."""
        shape: Decoded = state.shape
        eye = jnp.eye(len(shape.scales))
        lowest = jnp.linalg.eigvalsh(shape.pending)[0]
        share = jnp.minimum(1.0, LARGEST_STEP / jnp.maximum(-lowest, 1e-300))
        r = shape.root @ (eye + share * shape.pending) @ shape.root
        deviations = jnp.sqrt(jnp.diag(r))
        r = (r + r.T) / (2 * deviations[:, None] * deviations)
        values, axes = jnp.linalg.eigh(r)
        roots = jnp.sqrt(jnp.maximum(values, 1e-300))
        return state._replace(
            shape=shape._replace(
                scales=shape.scales * deviations,
                correlations=r,
                root=(axes * roots) @ axes.T,
                inverse=(axes / roots) @ axes.T,
                roots=roots,
                pending=jnp.zeros_like(r),
            )
        )

    def fresh_shape(self, n: int) -> Decoded:
        eye, zeros, zero = jnp.eye(n), jnp.zeros(n), jnp.asarray(0.0)
        return Decoded(jnp.ones(n), eye, eye, eye, jnp.ones(n), jnp.zeros((n, n)), zeros, zero, zeros, zero)

    def stretch(self, shape: Decoded, z: Array) -> Array:
        return shape.scales * (z @ shape.root)

    def whiten(self, shape: Decoded, y: Array) -> Array:
        return (y / shape.scales) @ shape.inverse

    def variances(self, shape: Decoded) -> Array:
        return shape.scales**2

    def lengths(self, shape: Decoded) -> Array:
        # bounds of the condition of D R D; its own eigenvalues would cost another decomposition
        return jnp.array([jnp.max(shape.scales) * jnp.max(shape.roots), jnp.min(shape.scales) * jnp.min(shape.roots)])

    def axis(self, shape: Decoded, k: Array) -> Array:
        return shape.scales * shape.root[:, k]

    def learn(self, shape: Decoded, ranked: Ranked) -> Decoded:
        n = ranked.y.shape[1]
        matrix, scale = _matrix_rates(*ranked.y.shape), _scale_rates(*ranked.y.shape)
        path, weight = _path(matrix, ranked, shape.path, shape.path_weight)
        scale_path, scale_weight = _path(scale, ranked, shape.scale_path, shape.scale_weight)
        paths = self.whiten(shape, jnp.stack([path, scale_path]))
        # R, in whitened coordinates, relative to the identity
        w = ranked.weighted(matrix.w)
        rank_one = jnp.outer(paths[0], paths[0]) - weight * jnp.eye(n)
        drift = jnp.sum(jnp.where(ranked.usable, jnp.asarray(matrix.w), 0.0))
        rank_mu = (ranked.white.T * w) @ ranked.white - drift * jnp.eye(n)
        # D
        v = ranked.weighted(scale.w)
        change = scale.c_1 * (paths[1] ** 2 - scale_weight) + scale.c_mu * v @ (ranked.white**2 - 1)
        slowness = jnp.maximum(1.0, jnp.max(shape.roots) / jnp.min(shape.roots) - FREE + 1)
        return shape._replace(
            scales=shape.scales * jnp.exp(jnp.clip(change / (2 * slowness), -1.0, 1.0)),
            pending=shape.pending + matrix.c_mu * rank_mu + matrix.c_1 * rank_one,
            path=path,
            path_weight=weight,
            scale_path=scale_path,
            scale_weight=scale_weight,
        )


def _matrix_rates(rows: int, n: int) -> Rates:
    return decoding_rates(rows, n, n * (n + 1) / 2)


def _scale_rates(rows: int, n: int) -> Rates:
    return decoding_rates(rows, n, n)


def _path(r: Rates, ranked: Ranked, path: Array, weight: Array) -> tuple[Array, Array]:
    """A path of the mean, and the variance that it would have under random selection."""
    fresh = r.c_c * (2 - r.c_c)
    path = (1 - r.c_c) * path + ranked.h * math.sqrt(fresh * ranked.mu_eff) * ranked.step
    return path, (1 - r.c_c) ** 2 * weight + ranked.h * fresh
