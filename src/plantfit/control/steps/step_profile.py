"""A reference that steps through several levels, and what each step is judged by."""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from plantfit.errors import SimulationError
from plantfit.runtime import jit
from plantfit.simulate.loop.closed_loop import Observer

import jax
import jax.numpy as jnp
from jax import lax


@dataclass(frozen=True)
class StepProfile:
    """Levels of the reference and the times (s) from which they hold, the first 0, until `seconds`; `band`: see
    `StepScores`."""

    times: tuple[float, ...]
    levels: tuple[float, ...]
    seconds: float
    band: float = 0.02

    def __post_init__(self) -> None:
        for name in ("times", "levels"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        ends = (*self.times, self.seconds)
        if len(self.times) != len(self.levels) or not self.times or self.times[0] != 0 or not np.all(np.diff(ends) > 0):
            raise SimulationError(
                f"The profile has times {list(self.times)}, levels {list(self.levels)} and ends at {self.seconds:g} s; "
                "give a level for each time, times that increase from 0, and an end after them."
            )
        if not 0 < self.band < 1:
            raise SimulationError(f"band = {self.band}; give a share of the step between 0 and 1, such as 0.02.")

    def samples(self, period: float) -> int:
        """Controller samples of the whole profile."""
        return round(self.seconds / period)

    def reference(self, period: float) -> np.ndarray:
        """The level of every sample (N,)."""
        t = period * np.arange(self.samples(period))
        return np.asarray(self.levels)[np.searchsorted(self.times, t + 1e-9 * period, side="right") - 1]

    def observer(self) -> Observer:
        """For `ClosedLoop.observe` of a loop over one signal: gives `StepScores`."""
        return _observer(self)


class StepScores(NamedTuple):
    """Judgement of each step (S,), from the output at its beginning to its level; times in seconds after its beginning.

    `iae`: integral of |level - y| over the size of the step (s); `overshoot` beyond the level in percent of the step;
    `settling` of the first sample from which y stays within `band` of the step (inf if never); `travel`: sum of the
    moves of the input.
    """

    iae: Any
    overshoot: Any
    settling: Any
    travel: Any


def profile_scores(profile: StepProfile, t: Any, y: Any, u: Any) -> StepScores:
    """`StepScores` of stored responses y and inputs u (..., N) at times t (N,) in seconds, by the code of the loop's
    observer."""
    t, y, u = (np.asarray(v, dtype=float) for v in (t, y, u))
    if t.ndim != 1 or y.shape != u.shape or y.shape[-1:] != t.shape or not len(t):
        raise SimulationError(
            f"The responses have times {t.shape}, outputs {y.shape} "
            f"and inputs {u.shape}; give (N,), (..., N), (..., N)."
        )
    found = _fold(profile, t, y.reshape(-1, len(t)), u.reshape(-1, len(t)))
    return StepScores(*(np.asarray(v).reshape(*y.shape[:-1], len(profile.times)) for v in found))


@partial(jit, static_argnums=0)
def _fold(profile: StepProfile, t: Any, ys: Any, us: Any) -> StepScores:
    observer = _observer(profile)

    def one(y, u):
        def step(seen, row):
            return observer.update(seen, row[0], row[1], row[2], 0.0), None

        return observer.result(lax.scan(step, observer.init(y[0], 0.0), (t, y, u))[0])

    return jax.vmap(one)(ys, us)


class _Seen(NamedTuple):
    begin: Any  # output at the beginning of each step (S,)
    area: Any
    beyond: Any
    settled: Any
    travel: Any
    last_t: Any
    last_u: Any


@lru_cache(maxsize=32)  # one identity per profile, so that loops compile once
def _observer(profile: StepProfile) -> Observer:
    times, levels = np.asarray(profile.times), np.asarray(profile.levels)

    def init(y, reference):
        each = jnp.zeros(len(times)) + 0.0 * y
        return _Seen(each + y, each, each, each + jnp.inf, each, 0.0 * y - jnp.inf, 0.0 * y)

    def update(seen, t, y, u, reference):
        begun = t >= times - 1e-9
        now = begun & (t < np.r_[times[1:], np.inf] - 1e-9)
        first, very_first = begun & ~(seen.last_t >= times - 1e-9), jnp.isneginf(seen.last_t)
        begin = jnp.where(first, y, seen.begin)
        size, off = jnp.abs(levels - begin), jnp.abs(levels - y)
        since = jnp.where(very_first, 0.0, t - seen.last_t)
        # nan is not inside
        settled = jnp.where(off <= profile.band * size, jnp.minimum(seen.settled, t - times), jnp.inf)
        return _Seen(
            begin,
            seen.area + jnp.where(now & ~first, since * off, 0.0),
            jnp.where(now, jnp.maximum(seen.beyond, jnp.sign(levels - begin) * (y - levels)), seen.beyond),
            jnp.where(now, settled, seen.settled),
            seen.travel + jnp.where(now & ~very_first, jnp.abs(u - seen.last_u), 0.0),
            t,
            u,
        )

    def result(seen):
        size = jnp.abs(levels - seen.begin)
        step = size > 0
        safe = jnp.where(step, size, 1.0)
        gone = jnp.where(jnp.isfinite(seen.area), 0.0, jnp.nan)  # nan spreads; comparisons would have hidden it
        overshoot = jnp.where(step, 100.0 * seen.beyond / safe, jnp.nan) + gone
        return StepScores(jnp.where(step, seen.area / safe, jnp.nan), overshoot, seen.settled + gone, seen.travel)

    return Observer(init, update, result)
