"""CMA-ES: full covariance with active update, adaptive bound penalty and simple restarts."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import integer, number

import jax
import jax.numpy as jnp
from jax import Array


class Weights(NamedTuple):
    """Strategy parameters of Hansen, arXiv:1604.00772, table 1 (eq. 49-58)."""

    w: np.ndarray
    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_1: float
    c_mu: float
    chi: float


@lru_cache(maxsize=64)
def strategy(rows: int, dimension: int) -> Weights:
    """The default strategy parameters for `rows` candidates in `dimension` coordinates."""
    n, mu = dimension, rows // 2
    raw = np.log((rows + 1) / 2) - np.log(np.arange(1, rows + 1))
    up, down = raw[:mu], raw[mu:]
    mu_eff, mu_eff_down = up.sum() ** 2 / (up**2).sum(), down.sum() ** 2 / max((down**2).sum(), 1e-300)
    c_sigma = (mu_eff + 2) / (n + mu_eff + 5)
    d_sigma = 1 + 2 * max(0.0, math.sqrt(max(mu_eff - 1, 0) / (n + 1)) - 1) + c_sigma
    c_c = (4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n)
    c_1 = 2 / ((n + 1.3) ** 2 + mu_eff)
    c_mu = min(1 - c_1, 2 * (0.25 + mu_eff + 1 / mu_eff - 2) / ((n + 2) ** 2 + mu_eff))
    limit = min(1 + c_1 / c_mu, 1 + 2 * mu_eff_down / (mu_eff + 2), (1 - c_1 - c_mu) / (n * c_mu))
    negative = np.where(raw < 0, raw, 0.0)
    w = np.where(raw > 0, raw / raw[raw > 0].sum(), limit * negative / max(-negative.sum(), 1e-300))
    chi = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
    return Weights(w, mu_eff, c_sigma, d_sigma, c_c, c_1, c_mu, chi)


class Search(NamedTuple):
    """State: the distribution, its paths, the bound penalty and what the stop rules need."""

    mean: Array
    sigma: Array
    cov: Array
    axes: Array  # B, eigenvectors of cov in columns
    lengths: Array  # D, square roots of the eigenvalues
    path_sigma: Array
    path_c: Array
    raw: Array  # candidates before they were clipped
    spare: Array  # the mean of the next restart
    generation: Array  # since the last restart
    since_improvement: Array
    best: Array  # best cost since the last restart
    bests: Array  # ring of the last best costs
    spreads: Array  # ring of interquartile ranges of cost, in units of the step
    penalty: Array  # gamma of the bound penalty, 0 until it is needed
    restarts: Array


@dataclass(frozen=True)
class CmaEs:
    """(mu/mu_w, lambda)-CMA-ES with negative weights (Hansen, The CMA Evolution Strategy: A Tutorial,
    arXiv:1604.00772, algorithm of fig. 6).

    Candidates outside the cube are evaluated at the nearest point inside and pay an adaptive penalty
    gamma_j (distance_j)^2 / xi_j; the update uses the point outside (Hansen, Niederberger, Guzzella and
    Koumoutsakos 2009, IEEE TEC 13:180, section IV-B). Candidates that cannot be simulated have no weight.
    When its own stop rules hold, the search restarts from a new uniform mean with the same population
    (shapes are fixed), and ends as converged when its restarts are used up. Foreign points in the first
    generation are taken in with their length limited (Hansen 2011, arXiv:1110.4181, eq. 4).
    """

    needs: ClassVar[Needs] = Needs(minimum_population=4)
    population: int | None = integer(None, 4, 100_000, "candidates per generation; by default 4 + 3 ln(d)")
    sigma: float = number(0.3, 1e-6, 1.0, "first step size, as a share of each range")
    restarts: int = integer(9, 0, 1_000_000, "how many times the search may begin anew after it converged")

    def rows(self, facts: Facts) -> int:
        return self.population if self.population is not None else 4 + math.floor(3 * math.log(facts.dimension))

    def refresh_period(self, facts: Facts) -> int:
        s = strategy(self.rows(facts), facts.dimension)
        return max(1, math.floor(1 / (10 * facts.dimension * (s.c_1 + s.c_mu))))

    def refresh(self, state: Search) -> Search:
        values, vectors = jnp.linalg.eigh(state.cov)
        return state._replace(axes=vectors, lengths=jnp.sqrt(jnp.maximum(values, 1e-300)))

    def init(self, key: Array, facts: Facts) -> Search:
        n, rows = facts.dimension, self.rows(facts)
        eye, zero = jnp.eye(n), jnp.zeros((), int)
        mean = jax.random.uniform(key, (n,))
        ring, spreads = 10 + math.ceil(30 * n / rows), 20 + math.ceil(3 * n / rows)
        return Search(
            mean, jnp.asarray(self.sigma), eye, eye, jnp.ones(n), jnp.zeros(n), jnp.zeros(n), jnp.zeros((rows, n)), mean,
            zero, zero, jnp.asarray(jnp.inf), jnp.full(ring, jnp.inf), jnp.full(spreads, jnp.nan), jnp.zeros(n), zero,
        )  # fmt: skip

    def ask(self, key: Array, state: Search) -> tuple[Array, Search]:
        draw, place = jax.random.split(key)
        z = jax.random.normal(draw, state.raw.shape)
        raw = state.mean + state.sigma * (z * state.lengths) @ state.axes.T
        return jnp.clip(raw, 0.0, 1.0), state._replace(raw=raw, spare=jax.random.uniform(place, state.mean.shape))

    def tell(self, state: Search, x: Array, f: Array) -> tuple[Search, Info]:
        foreign = jnp.any(x != jnp.clip(state.raw, 0.0, 1.0), axis=1, keepdims=True)
        y = (jnp.where(foreign, x, state.raw) - state.mean) / state.sigma
        y = jnp.where(foreign, y * self._shortening(state, y)[:, None], y)
        penalised = f + self._penalties(state, state.mean + state.sigma * y)
        updated = self._penalty_update(self._update(state, y, penalised), f)
        updated = self._remember(updated, state, f)
        alive = jnp.any(jnp.isfinite(f))
        kept = jax.tree.map(lambda new, old: jnp.where(alive, new, old), updated, state)
        done = ~alive | self._finished(kept)
        last = done & (kept.restarts >= self.restarts)
        fresh = self._restart(kept)
        return jax.tree.map(lambda new, old: jnp.where(done, new, old), fresh, kept), {"stop": last}

    def _whiten(self, state: Search, y: Array) -> Array:
        """C^(-1/2) y for rows of y."""
        return ((y @ state.axes) / state.lengths) @ state.axes.T

    def _shortening(self, state: Search, y: Array) -> Array:
        n = y.shape[1]
        length = jnp.linalg.norm(self._whiten(state, y), axis=1)
        return jnp.minimum(1.0, (math.sqrt(n) + 2 * n / (n + 2)) / jnp.maximum(length, 1e-300))

    def _update(self, state: Search, y: Array, f: Array) -> Search:
        """Mean, paths, covariance and step size: eq. 38-47 of the tutorial."""
        n, s = y.shape[1], strategy(*y.shape)
        order = jnp.argsort(f)
        y, usable = y[order], jnp.isfinite(f[order])
        w = jnp.where(usable, jnp.asarray(s.w), 0.0)
        parents = jnp.where(w > 0, w, 0.0)
        parents = parents / jnp.maximum(jnp.sum(parents), 1e-300)
        w = jnp.where(w > 0, parents, w)
        step = parents @ y
        white = self._whiten(state, y)
        path_sigma = (1 - s.c_sigma) * state.path_sigma + math.sqrt(s.c_sigma * (2 - s.c_sigma) * s.mu_eff) * (parents @ white)
        length = jnp.linalg.norm(path_sigma)
        fade = jnp.sqrt(1 - (1 - s.c_sigma) ** (2.0 * (state.generation + 1)))
        h = jnp.where(length / fade < (1.4 + 2 / (n + 1)) * s.chi, 1.0, 0.0)
        path_c = (1 - s.c_c) * state.path_c + h * math.sqrt(s.c_c * (2 - s.c_c) * s.mu_eff) * step
        scaled = jnp.where(w < 0, w * n / jnp.maximum(jnp.sum(white**2, axis=1), 1e-300), w)
        keep = 1 + s.c_1 * (1 - h) * s.c_c * (2 - s.c_c) - s.c_1 - s.c_mu * jnp.sum(w)
        cov = keep * state.cov + s.c_1 * jnp.outer(path_c, path_c) + s.c_mu * (y.T * scaled) @ y
        cov = (cov + cov.T) / 2
        sigma = state.sigma * jnp.exp(jnp.minimum(1.0, (s.c_sigma / s.d_sigma) * (length / s.chi - 1)))
        # a step wider than the box carries no information
        sigma = jnp.minimum(sigma, (1 / 3) / jnp.sqrt(jnp.maximum(jnp.max(jnp.diag(cov)), 1e-300)))
        return state._replace(mean=state.mean + state.sigma * step, sigma=sigma, cov=cov, path_sigma=path_sigma, path_c=path_c)

    def _penalties(self, state: Search, raw: Array) -> Array:
        log_var = jnp.log(jnp.maximum(jnp.diag(state.cov), 1e-300))
        xi = jnp.exp(0.9 * (log_var - jnp.mean(log_var)))
        return jnp.mean(state.penalty * (raw - jnp.clip(raw, 0.0, 1.0)) ** 2 / xi, axis=1)

    def _penalty_update(self, state: Search, f: Array) -> Search:
        n, s = len(state.mean), strategy(len(f), len(state.mean))
        low, high = jnp.nanquantile(jnp.where(jnp.isfinite(f), f, jnp.nan), jnp.array([0.25, 0.75]))
        var = jnp.diag(state.cov)
        unit = state.sigma**2 * jnp.mean(var)
        spreads = jnp.roll(state.spreads, 1).at[0].set((high - low) / jnp.maximum(unit, 1e-300))
        outside = jnp.abs(state.mean - jnp.clip(state.mean, 0.0, 1.0))
        begin = jnp.any(outside > 0) & jnp.all(state.penalty == 0)
        penalty = jnp.where(begin, 2 * jnp.nanmedian(spreads), state.penalty)
        far = outside > 3 * state.sigma * jnp.sqrt(var) * max(1.0, math.sqrt(n) / s.mu_eff)
        penalty = jnp.where(far, penalty * 1.1 ** max(1.0, s.mu_eff / (10 * n)), penalty)
        return state._replace(spreads=spreads, penalty=penalty)

    def _remember(self, updated: Search, state: Search, f: Array) -> Search:
        lowest = jnp.min(f)
        return updated._replace(
            generation=state.generation + 1,
            best=jnp.minimum(state.best, lowest),
            since_improvement=jnp.where(lowest < state.best, 0, state.since_improvement + 1),
            bests=jnp.roll(state.bests, 1).at[0].set(lowest),
        )

    def _finished(self, state: Search) -> Array:
        """The stop rules of the tutorial, B.3; tolerances on cost are relative."""
        n, rows = len(state.mean), len(state.raw)
        deviations = jnp.sqrt(jnp.maximum(jnp.diag(state.cov), 0.0))
        narrow = state.sigma * jnp.max(jnp.maximum(deviations, jnp.abs(state.path_c))) < 1e-11
        full = state.generation >= len(state.bests)
        level = full & (jnp.max(state.bests) - jnp.min(state.bests) <= 1e-12 * jnp.abs(state.best))
        wide = state.sigma * jnp.max(state.lengths) > 1e4 * self.sigma
        crooked = jnp.max(state.lengths) > 1e7 * jnp.min(state.lengths)
        k = state.generation % n
        along = state.mean + 0.1 * state.sigma * state.lengths[k] * state.axes[:, k]
        no_effect = jnp.all(along == state.mean) | jnp.any(state.mean + 0.2 * state.sigma * deviations == state.mean)
        stale = state.since_improvement > 100 + 100 * n**1.5 / rows
        broken = ~(jnp.all(jnp.isfinite(state.cov)) & jnp.isfinite(state.sigma))
        return narrow | level | wide | crooked | no_effect | stale | broken

    def _restart(self, state: Search) -> Search:
        n, zero = len(state.mean), jnp.zeros((), int)
        eye = jnp.eye(n)
        return state._replace(
            mean=state.spare, sigma=jnp.asarray(self.sigma), cov=eye, axes=eye, lengths=jnp.ones(n),
            path_sigma=jnp.zeros(n), path_c=jnp.zeros(n), generation=zero, since_improvement=zero, best=jnp.asarray(jnp.inf),
            bests=jnp.full_like(state.bests, jnp.inf), spreads=jnp.full_like(state.spreads, jnp.nan),
            penalty=jnp.zeros(n), restarts=state.restarts + 1,
        )  # fmt: skip
