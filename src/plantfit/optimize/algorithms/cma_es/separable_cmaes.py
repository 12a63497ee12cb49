"""Separable CMA-ES: a diagonal covariance, learned d times faster than a full one."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.evolution_strategy import EvolutionStrategy, Ranked
from plantfit.optimize.algorithms.cma_es.learning_rates import separable_rates
from plantfit.optimize.settings import choice

import jax.numpy as jnp
from jax import Array


class Diagonal(NamedTuple):
    """Variances of the coordinates and their path, both (d,)."""

    var: Array
    path: Array

    @property
    def cov(self) -> Array:
        return jnp.diag(self.var)


@dataclass(frozen=True)
class SeparableCmaEs(EvolutionStrategy):
    """sep-CMA-ES (Ros and Hansen 2008, A Simple Modification in CMA-ES Achieving Linear Time and Space Complexity,
    PPSN X, LNCS 5199:296) with negative weights.

    Learns a scale for every parameter and no direction: O(d) per candidate. Restarts, warm starts, failures and
    bounds as in CmaEs.
    """

    bounds: str = choice("mirror", ("mirror", "penalty"), "at a bound: fold back, or clip and pay for the distance")

    def fresh_shape(self, n: int) -> Diagonal:
        return Diagonal(jnp.ones(n), jnp.zeros(n))

    def stretch(self, shape: Diagonal, z: Array) -> Array:
        return z * jnp.sqrt(shape.var)

    def whiten(self, shape: Diagonal, y: Array) -> Array:
        return y / jnp.sqrt(shape.var)

    def variances(self, shape: Diagonal) -> Array:
        return shape.var

    def lengths(self, shape: Diagonal) -> Array:
        return jnp.sqrt(shape.var)

    def axis(self, shape: Diagonal, k: Array) -> Array:
        return jnp.zeros_like(shape.var).at[k].set(jnp.sqrt(shape.var[k]))

    def learn(self, shape: Diagonal, ranked: Ranked) -> Diagonal:
        """The diagonal of the update of CMA-ES, with its own rates."""
        r = separable_rates(*ranked.y.shape)
        path = (1 - r.c_c) * shape.path + ranked.h * math.sqrt(r.c_c * (2 - r.c_c) * ranked.mu_eff) * ranked.step
        w = jnp.where(ranked.usable, jnp.asarray(r.w), 0.0)
        keep = 1 + r.c_1 * (1 - ranked.h) * r.c_c * (2 - r.c_c) - r.c_1 - r.c_mu * jnp.sum(w)
        var = keep * shape.var + r.c_1 * path**2 + r.c_mu * ranked.weighted(r.w) @ ranked.y**2
        return Diagonal(jnp.maximum(var, 1e-300), path)
