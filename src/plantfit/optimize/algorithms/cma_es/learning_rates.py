"""Weights and learning rates of the covariance matrix adaptation strategies, from population and dimension alone."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np


class Rates(NamedTuple):
    """How fast one matrix learns: rank-one c_1, rank-mu c_mu, path c_c, and the weights (rows,) with their negative
    part."""

    c_1: float
    c_mu: float
    c_c: float
    w: np.ndarray


class Weights(NamedTuple):
    """Recombination and step size: parents (rows,) sum to 1; `raw` are the unscaled weights, best first."""

    raw: np.ndarray
    parents: np.ndarray
    mu_eff: float
    mu_eff_down: float
    c_sigma: float
    d_sigma: float
    chi: float


@lru_cache(maxsize=64)
def weights(rows: int, dimension: int) -> Weights:
    """Hansen 2016, arXiv:1604.00772, eq. 49-51 (weights) and 55 (step size)."""
    n = dimension
    raw = np.log((rows + 1) / 2) - np.log(np.arange(1, rows + 1))
    up, down = raw[: rows // 2], raw[rows // 2 :]
    mu_eff, mu_eff_down = up.sum() ** 2 / (up**2).sum(), down.sum() ** 2 / max((down**2).sum(), 1e-300)
    c_sigma = (mu_eff + 2) / (n + mu_eff + 5)
    d_sigma = 1 + 2 * max(0.0, math.sqrt(max(mu_eff - 1, 0) / (n + 1)) - 1) + c_sigma
    chi = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
    return Weights(raw, np.where(raw > 0, raw / raw[raw > 0].sum(), 0.0), mu_eff, mu_eff_down, c_sigma, d_sigma, chi)


def _with_negative(s: Weights, limit: float) -> np.ndarray:
    """The parents' weights, and negative ones that sum to -limit."""
    negative = np.where(s.raw < 0, s.raw, 0.0)
    return s.parents + limit * negative / max(-negative.sum(), 1e-300)


@lru_cache(maxsize=64)
def full_rates(rows: int, dimension: int) -> Rates:
    """Rates of the whole covariance matrix: Hansen 2016, eq. 53 and 56-58."""
    n, s = dimension, weights(rows, dimension)
    c_c = (4 + s.mu_eff / n) / (n + 4 + 2 * s.mu_eff / n)
    c_1 = 2 / ((n + 1.3) ** 2 + s.mu_eff)
    c_mu = min(1 - c_1, 2 * (0.25 + s.mu_eff + 1 / s.mu_eff - 2) / ((n + 2) ** 2 + s.mu_eff))
    # the last term keeps the matrix positive definite
    limit = min(1 + c_1 / c_mu, 1 + 2 * s.mu_eff_down / (s.mu_eff + 2), (1 - c_1 - c_mu) / (n * c_mu))
    return Rates(c_1, c_mu, c_c, _with_negative(s, limit))


@lru_cache(maxsize=64)
def separable_rates(rows: int, dimension: int) -> Rates:
    """Rates of a diagonal matrix: n unknowns instead of n (n + 1) / 2 allow n times faster learning.

    Ros and Hansen 2008, PPSN X, LNCS 5199:296, in the later form of Hansen's own program.
    """
    n, s = dimension, weights(rows, dimension)
    c_c = (1 + 1 / n + s.mu_eff / n) / (math.sqrt(n) + 1 / n + 2 * s.mu_eff / n)
    c_1 = 1 / (n + 2 * math.sqrt(n) + s.mu_eff / n)
    c_mu = min(1 - c_1, (s.mu_eff + 1 / s.mu_eff - 1.75) / (n + 4 * math.sqrt(n) + s.mu_eff / 2))
    limit = min(1 + c_1 / c_mu, 1 + 2 * s.mu_eff_down / (s.mu_eff + 2), (1 - c_1 - c_mu) / (n * c_mu))
    return Rates(c_1, c_mu, c_c, _with_negative(s, limit))


@lru_cache(maxsize=64)
def decoding_rates(rows: int, dimension: int, unknowns: float) -> Rates:
    """Rates of a matrix with `unknowns` degrees of freedom: Akimoto and Hansen 2020, Evolutionary Computation
    28:405."""
    n, s = dimension, weights(rows, dimension)
    mu = s.mu_eff + 1 / s.mu_eff - 2 + rows / (2 * (rows + 5))
    c_1 = 1 / (2 * (unknowns / n + 1) * (n + 1) ** 0.75 + s.mu_eff / 2)
    c_mu = min(1 - c_1, mu * c_1)
    limit = min(1 + c_1 / c_mu, 1 + 2 * s.mu_eff_down / (s.mu_eff + 2))
    return Rates(c_1, c_mu, math.sqrt(s.mu_eff * c_1) / 2, _with_negative(s, limit))


def period(rates: Rates, dimension: int) -> int:
    """Generations between two eigendecompositions.

    As often as Hansen 2016, section B.2, or as long as the matrix forgets no more than 1 % of itself in between: the
    first keeps small searches exact, the second keeps large ones cheap.
    """
    speed = rates.c_1 + rates.c_mu
    return max(1, math.floor(1 / (10 * dimension * speed)), math.floor(0.01 / speed))
