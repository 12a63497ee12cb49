"""What the covariance matrix adaptation strategies share: mean, step size, bounds, foreign points, stop rules,
restarts."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.algorithms.cma_es.bound_penalty import Penalty, adapted, mirrored, no_penalty, penalties
from plantfit.optimize.algorithms.cma_es.learning_rates import Weights, weights
from plantfit.optimize.algorithms.cma_es.stop_rules import Memory, degenerate, exhausted, nothing_yet, remember
from plantfit.optimize.contract import Facts, Info, Needs
from plantfit.optimize.settings import choice, integer, number

import jax
import jax.numpy as jnp
from jax import Array, lax

LARGE = 300  # dimension from which the step size follows two points instead of a path, and bounds fold back
NEAR, NEAR_LARGE = 0.4, 0.1  # length of a first step around a warm start, in ranges; the latter from LARGE on
WIDEST = 1 / 3  # largest standard deviation of a coordinate
ROUNDING = 1e-14  # of a coordinate: by so much a program may round a candidate that it makes in two places differently


class Search(NamedTuple):
    """The distribution mean + sigma N(0, C); `shape` is C as the variant keeps it, with members `cov` and `path`."""

    mean: Array
    sigma: Array
    shape: Any
    path_sigma: Array
    trend: Array  # s of the two-point rule
    shift: Array  # last step of the mean, (d,)
    z: Array  # standard normal draws (rows, d)
    raw: Array  # candidates before the bounds were kept
    memory: Memory
    penalty: Penalty
    first: Array  # first step size of this search
    cold: Array  # first step size from a random mean
    warm: Array  # first step size around a warm start
    spare: Array  # the mean of the next restart
    restarts: Array

    @property
    def cov(self) -> Array:
        return self.shape.cov


class Ranked(NamedTuple):
    """One generation, best first: steps in units of sigma (rows, d), the same whitened, which can be used, and the
    mean's step with its whitened form (d,). `h` is 0 while the path is too long to be trusted, else 1."""

    y: Array
    white: Array
    usable: Array
    step: Array
    white_step: Array
    h: Array
    mu_eff: float

    def weighted(self, w: Array | np.ndarray) -> Array:
        """Weights w (rows,) without candidates that failed; the positive ones sum to 1, the negative ones are scaled so
        that no step counts for more than its direction (Hansen 2016, eq. 46)."""
        n = self.y.shape[1]
        w = jnp.where(self.usable, w, 0.0)
        total = jnp.maximum(jnp.sum(jnp.where(w > 0, w, 0.0)), 1e-300)
        return jnp.where(w < 0, w * n / jnp.maximum(jnp.sum(self.white**2, axis=1), 1e-300), w / total)


def _one_of(first: Array, these: Search, those: Search) -> Search:
    """`these` if `first`, else `those`. What both share is not chosen number by number: for large matrices that takes
    as long as a generation."""
    return jax.tree.map(lambda a, b: a if a is b else jnp.where(first, a, b), these, those)


@dataclass(frozen=True)
class EvolutionStrategy(ABC):
    """(mu/mu_w, lambda) strategy around a shape that a variant defines by `fresh_shape`, `stretch`, `whiten`,
    `variances`, `lengths`, `axis` and `learn`.

    The search begins at the first warm start, where there is one, else at a uniform point. When in the first
    generation another warm start is the best candidate, the mean moves there and nothing is learned from that
    generation. Foreign points further on are taken in with limited length (Hansen 2011, arXiv:1110.4181, eq. 4).
    """

    needs: ClassVar[Needs] = Needs(minimum_population=4)
    population: int | None = integer(None, 4, 100_000, "candidates per generation; by default 4 + 3 ln(d)")
    sigma: float | None = number(
        None,
        1e-6,
        1.0,
        "first step size, as a share of each range; by default 0.3, around a warm start 0.4 / sqrt(d), 0.1 / sqrt(d) "
        "from 300 parameters, "
        "and at most 0.2",
    )
    restarts: int = integer(9, 0, 1_000_000, "how many times the search may begin anew, anywhere, after it converged")
    bounds: str = choice(
        "auto",
        ("auto", "penalty", "mirror"),
        "at a bound: clip and pay for the distance, or fold back; by default every second restart folds back, and all "
        "from 300 parameters",
    )
    steps: str = choice(
        "auto",
        ("auto", "path", "two_point"),
        "step size from the length of the path or from two trial points; two_point from 300 parameters",
    )

    def rows(self, facts: Facts) -> int:
        return self.population if self.population is not None else 4 + math.floor(3 * math.log(facts.dimension))

    def init(self, key: Array, facts: Facts) -> Search:
        n, rows = facts.dimension, self.rows(facts)
        zeros = jnp.zeros(n)
        cold = jnp.asarray(0.3 if self.sigma is None else self.sigma, float)
        near = NEAR_LARGE if n >= LARGE else NEAR
        warm = jnp.asarray(min(0.2, near / math.sqrt(n)) if self.sigma is None else self.sigma, float)
        given = facts.start is not None and len(facts.start) > 0
        mean = jnp.clip(jnp.asarray(facts.start[0], float), 0.0, 1.0) if given else jax.random.uniform(key, (n,))  # pyrefly: ignore[unsupported-operation]
        sigma = warm if given else cold
        # after a trusted guess the next search looks anywhere
        cold = jnp.maximum(cold, 0.3) if given else cold
        empty = jnp.zeros((rows, n))
        return Search(
            mean, sigma, self.fresh_shape(n), zeros, jnp.asarray(0.0), zeros, empty, empty, nothing_yet(rows, n),
            no_penalty(rows, n), sigma, cold, warm, mean, jnp.zeros((), int),
        )  # fmt: skip

    def ask(self, key: Array, state: Search) -> tuple[Array, Search]:
        draw, place, length = jax.random.split(key, 3)
        z = jax.random.normal(draw, state.raw.shape)
        if self._two_point(z.shape[1]):
            z = self._trial_points(length, state, z)
        raw = state.mean + state.sigma * self.stretch(state.shape, z)
        return self._inside(raw, state), state._replace(z=z, raw=raw, spare=jax.random.uniform(place, state.mean.shape))

    def tell(self, state: Search, x: Array, f: Array) -> tuple[Search, Info]:
        n = x.shape[1]
        foreign = jnp.any(jnp.abs(x - self._inside(state.raw, state)) > ROUNDING, axis=1)
        y, white = lax.cond(
            jnp.any(foreign), self._taken_in, lambda s, x, _: ((s.raw - s.mean) / s.sigma, s.z), state, x, foreign
        )
        cost = f
        if self._mirrors(n) != "always":
            paid = penalties(state.penalty, state.mean + state.sigma * y, self.variances(state.shape))
            cost = f + jnp.where(self._folds(state), 0.0, paid)
        jump = (state.memory.generation == 0) & (state.restarts == 0) & foreign[jnp.argmin(f)]
        moved = state._replace(mean=x[jnp.argmin(f)], sigma=state.warm, first=state.warm)
        learned = self._update(state, y, white, cost)
        if self._mirrors(n) != "always":
            mu_eff = weights(*x.shape).mu_eff
            penalty = adapted(state.penalty, f, learned.mean, learned.sigma, self.variances(learned.shape), mu_eff)
            learned = learned._replace(penalty=penalty)
        updated = _one_of(jump, moved, learned)._replace(memory=remember(state.memory, f))
        alive = jnp.any(jnp.isfinite(f))
        kept = _one_of(alive, updated, state)
        done = ~alive | exhausted(kept.memory, f, n) | self._degenerate(kept)
        last = done & (kept.restarts >= self.restarts)
        fresh = self._restart(kept)
        return _one_of(done, fresh, kept), {"stop": last}

    @abstractmethod
    def fresh_shape(self, n: int) -> Any:
        """The sphere."""

    @abstractmethod
    def stretch(self, shape: Any, z: Array) -> Array:
        """C^(1/2) z for rows of z."""

    @abstractmethod
    def whiten(self, shape: Any, y: Array) -> Array:
        """C^(-1/2) y for rows of y."""

    @abstractmethod
    def variances(self, shape: Any) -> Array:
        """The diagonal of C."""

    @abstractmethod
    def lengths(self, shape: Any) -> Array:
        """Square roots of the eigenvalues of C."""

    @abstractmethod
    def axis(self, shape: Any, k: Array) -> Array:
        """Principal axis k of C, with its length."""

    @abstractmethod
    def learn(self, shape: Any, ranked: Ranked) -> Any:
        """The shape after one generation."""

    def _inside(self, raw: Array, state: Search) -> Array:
        return jnp.where(self._folds(state), mirrored(raw), jnp.clip(raw, 0.0, 1.0))

    def _folds(self, state: Search) -> Array:
        """Whether this search folds candidates back at the bounds."""
        mirrors = self._mirrors(state.mean.shape[0])
        return state.restarts % 2 == 1 if mirrors == "in turn" else jnp.asarray(mirrors == "always")

    def _mirrors(self, n: int) -> str:
        """Which searches fold back: "never", "always" or "in turn"."""
        if self.bounds == "auto":
            return "always" if n >= LARGE else "in turn"
        return "always" if self.bounds == "mirror" else "never"

    def _two_point(self, n: int) -> bool:
        return self.steps == "two_point" or (self.steps == "auto" and n >= LARGE)

    def _trial_points(self, key: Array, state: Search, z: Array) -> Array:
        """The first two draws lie along the last step of the mean, ahead and behind, as far out as the others."""
        along = self.whiten(state.shape, state.shift[None])[0]
        norm = jnp.linalg.norm(along)
        radius = jnp.linalg.norm(jax.random.normal(key, along.shape))
        pair = jnp.array([[1.0], [-1.0]]) * along * radius / jnp.maximum(norm, 1e-300)
        return jnp.where(norm > 0, z.at[:2].set(pair), z)

    def _taken_in(self, state: Search, x: Array, foreign: Array) -> tuple[Array, Array]:
        """Steps and whitened steps with foreign candidates in their place, no longer than a long draw."""
        n = x.shape[1]
        y = (jnp.where(foreign[:, None], x, state.raw) - state.mean) / state.sigma
        white = jnp.where(foreign[:, None], self.whiten(state.shape, y), state.z)
        longest = math.sqrt(n) + 2 * n / (n + 2)
        short = jnp.minimum(1.0, longest / jnp.maximum(jnp.linalg.norm(white, axis=1, keepdims=True), 1e-300))
        short = jnp.where(foreign[:, None], short, 1.0)
        return y * short, white * short

    def _update(self, state: Search, y: Array, white: Array, cost: Array) -> Search:
        """Mean, path, shape and step size: Hansen 2016, eq. 41-47, by the variant's `learn`."""
        n, s = y.shape[1], weights(*y.shape)
        order = jnp.argsort(cost)
        usable = jnp.isfinite(cost[order])
        parents = jnp.where(usable, jnp.asarray(s.parents), 0.0)
        parents = parents / jnp.maximum(jnp.sum(parents), 1e-300)
        step, white_step = parents @ y[order], parents @ white[order]
        path = (1 - s.c_sigma) * state.path_sigma + math.sqrt(
            s.c_sigma * (2 - s.c_sigma) * s.mu_eff
        ) * white_step  # eq. 43
        length = jnp.linalg.norm(path)
        fade = jnp.sqrt(1 - (1 - s.c_sigma) ** (2.0 * (state.memory.generation + 1)))
        h = jnp.where(length / fade < (1.4 + 2 / (n + 1)) * s.chi, 1.0, 0.0)
        shape = self.learn(state.shape, Ranked(y[order], white[order], usable, step, white_step, h, s.mu_eff))
        trend, growth = self._growth(state, s, length, order)
        # a step wider than the box carries no information
        widest = WIDEST / jnp.sqrt(jnp.maximum(jnp.max(self.variances(shape)), 1e-300))
        return state._replace(
            mean=state.mean + state.sigma * step, sigma=jnp.minimum(state.sigma * growth, widest), shape=shape,
            path_sigma=path, trend=trend, shift=state.sigma * step,
        )  # fmt: skip

    def _growth(self, state: Search, s: Weights, length: Array, order: Array) -> tuple[Array, Array]:
        """Trend and factor of the step size.

        From the path: eq. 44. From two points, ahead of and behind the mean: Hansen, Atamna and Auger 2014, PPSN XIII,
        LNCS 8672:60, section 3.2; the path needs d / mu_eff generations to see a change, the two points do not.
        """
        n = state.mean.shape[0]
        if not self._two_point(n):
            return state.trend, jnp.exp(jnp.minimum(1.0, (s.c_sigma / s.d_sigma) * (length / s.chi - 1)))
        rank = jnp.argsort(order)
        gain = jnp.where(jnp.any(state.shift != 0), (rank[1] - rank[0]) / (len(order) - 1), 0.0)
        trend = 0.7 * state.trend + 0.3 * gain
        return trend, jnp.exp(trend / math.sqrt(n))

    def _degenerate(self, state: Search) -> Array:
        axis = self.axis(state.shape, state.memory.generation % state.mean.shape[0])
        variances, lengths = self.variances(state.shape), self.lengths(state.shape)
        return degenerate(state.mean, state.sigma, state.first, variances, state.shape.path, lengths, axis)

    def _restart(self, state: Search) -> Search:
        rows, n = state.raw.shape
        zeros = jnp.zeros(n)
        return state._replace(
            mean=state.spare, sigma=state.cold, first=state.cold, shape=self.fresh_shape(n), path_sigma=zeros,
            trend=jnp.zeros_like(state.trend), shift=zeros, memory=nothing_yet(rows, n), penalty=no_penalty(rows, n),
            restarts=state.restarts + 1,
        )  # fmt: skip
