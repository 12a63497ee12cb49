"""Two ways to keep a strategy in the unit cube: an adaptive penalty on what was clipped, and mirrors at the bounds."""

import math
from typing import NamedTuple

import plantfit.runtime  # noqa: F401

import jax.numpy as jnp
from jax import Array


class Penalty(NamedTuple):
    """`gamma` (d,), 0 until it is needed; `spreads` is a ring of interquartile ranges of cost, in units of the step."""

    gamma: Array
    spreads: Array


def no_penalty(rows: int, dimension: int) -> Penalty:
    """Nothing is penalised yet; the ring holds 20 + 3 d / rows generations."""
    return Penalty(jnp.zeros(dimension), jnp.full(20 + math.ceil(3 * dimension / rows), jnp.nan))


def penalties(state: Penalty, raw: Array, variances: Array) -> Array:
    """What candidates (rows, d) pay for lying outside (rows,).

    Mean of gamma_j distance_j^2 / xi_j: Hansen, Niederberger, Guzzella and Koumoutsakos 2009, IEEE TEC 13:180, eq. 11.
    """
    log_var = jnp.log(jnp.maximum(variances, 1e-300))
    xi = jnp.exp(0.9 * (log_var - jnp.mean(log_var)))
    return jnp.mean(state.gamma * (raw - jnp.clip(raw, 0.0, 1.0)) ** 2 / xi, axis=1)


def adapted(state: Penalty, f: Array, mean: Array, sigma: Array, variances: Array, mu_eff: float) -> Penalty:
    """Weights that grow while the mean lies far outside (the same paper, section IV-B)."""
    n = len(mean)
    low, high = jnp.nanquantile(jnp.where(jnp.isfinite(f), f, jnp.nan), jnp.array([0.25, 0.75]))
    unit = sigma**2 * jnp.mean(variances)
    spreads = jnp.roll(state.spreads, 1).at[0].set((high - low) / jnp.maximum(unit, 1e-300))
    outside = jnp.abs(mean - jnp.clip(mean, 0.0, 1.0))
    begin = jnp.any(outside > 0) & jnp.all(state.gamma == 0)
    gamma = jnp.where(begin, 2 * jnp.nanmedian(spreads), state.gamma)
    far = outside > 3 * sigma * jnp.sqrt(variances) * max(1.0, math.sqrt(n) / mu_eff)
    return Penalty(jnp.where(far, gamma * 1.1 ** max(1.0, mu_eff / (10 * n)), gamma), spreads)


def mirrored(raw: Array) -> Array:
    """Points outside [0, 1] folded back at the bounds, any number of times."""
    y = jnp.mod(raw, 2.0)
    return jnp.where(y > 1, 2 - y, y)
