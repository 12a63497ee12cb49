"""State delays x(t - tau): the method of steps on a grid that knows where late kinks fall.

Past steps are kept as cubic Hermite pieces in a ring (A. Bellen, M. Zennaro, Numerical Methods for Delay Differential
Equations, Oxford 2003, ch. 3 and 6). The start of the record and every jump of an input leave a kink in the state that
comes back one delay later; steps end there, so their lengths depend smoothly on the delays and derivatives by a delay
are right on the sample grid, off it and at bounds. Before the first sample a state had its first value.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp

ECHOES = 3  # times that the kink at the start is followed: then it is smoother than the steppers notice
SLACK = 1e-9  # of a step


class Lag(NamedTuple):
    """The channel at `place` among the inputs holds the state number `state` of `delay` seconds ago (> 0)."""

    place: int
    state: int
    delay: Any


class Grid(NamedTuple):
    """Times (K + 1,) s where steps end, the sample (K,) at or before each step, and the place (N,) of every sample."""

    times: Any
    sample: Any
    rank: Any


def split(t: Any, substeps: int) -> Any:
    """Sample times (N,) with every interval cut into `substeps` equal steps, ((N - 1) substeps + 1,)."""
    xp = np if isinstance(t, np.ndarray) else jnp
    parts = t[:-1, None] + xp.diff(t)[:, None] * xp.arange(substeps) / substeps
    return xp.append(parts, t[-1])


def substeps_below(t: np.ndarray, shortest: float) -> int:
    """The least number of steps per sample interval of `t` (N,) s that keeps every step within the delay `shortest`
    (s).

    Raises SimulationError when the delay is not above 0.
    """
    if not shortest > 0:
        raise SimulationError(f"A state delay may become {shortest:g} s; raise its lower bound above 0 s.")
    return max(1, int(np.ceil(np.max(np.diff(t), initial=0.0) / shortest * (1.0 - SLACK))))


def ring_length(t: np.ndarray, substeps: int, jumps: np.ndarray, longest: Sequence[float]) -> int:
    """Pieces that must be kept: the most steps within the longest of the delays' upper bounds `longest` (s), plus some.

    `t`, `substeps` and `jumps` as for `history_grid`.
    """
    window = max(longest)

    def most(times):
        return int(np.max(np.searchsorted(times, times + window, "right") - np.arange(len(times)), initial=0))

    return most(split(t, substeps)) + len(longest) * (most(jumps) + ECHOES + 1) + 2


def history_grid(t: Any, substeps: int, jumps: Any, delays: Sequence[Any], edges: Sequence[Any] = ()) -> Grid:
    """The samples `t` (N,) s, `substeps` steps between two, and the echoes of start and `jumps` (E,) s of held inputs.

    `edges` are further times (E,) s where a step has to end: edges of inputs that arrive late. Everything may be
    traced; times are differentiable in delays and edges. What comes after the record falls on its end, before it on its
    start.
    """
    t = jnp.asarray(t, dtype=float)
    fine = split(t, substeps)
    lists = [fine, *(jnp.maximum(e, t[0]) for e in edges)]
    for delay in delays:
        lists.append(t[0] + delay * jnp.arange(1.0, ECHOES + 1.0))
        lists.append(jnp.asarray(jumps, dtype=float) + delay)
    # a stable sort: on ties samples come first
    times = jnp.sort(jnp.minimum(jnp.concatenate(lists), fine[-1]), stable=True)
    fixed = jax.lax.stop_gradient(times)
    sample = jnp.clip(jnp.searchsorted(t, fixed[:-1], side="right") - 1, 0, max(t.shape[0] - 2, 0))
    return Grid(times, sample, jnp.searchsorted(fixed, t, side="left"))


def delayed_rollout(
    step: Callable,
    rate: Callable[[Scalars, Scalars, Scalars], Scalars],
    x0: Scalars,
    u0: Scalars,
    u1: Scalars,
    p: Scalars,
    times: Any,
    lags: Sequence[Lag],
    slots: int,
) -> Scalars:
    """All states at the `times` (K + 1,) s of a `history_grid`: a tuple of arrays (K + 1,).

    `step` is a stepper, `x0` and `p` scalars. `u0`, `u1` are the channels at both ends of every step, each (K,), with
    any value at the places of `lags`; `slots` comes from `ring_length`. NaN from the first step that is longer than a
    delay (see `substeps_below`) or a delay longer than the ring holds. Differentiable in `x0`, `u0`, `u1`, `p`, `times`
    and delays, forward and reverse.
    """
    states = sorted({lag.state for lag in lags})
    count = times.shape[0] - 1
    lengths = jnp.diff(times)
    looks = [_Look.of(times, lag.delay, count, slots) for lag in lags]

    def body(carry, row):
        x, ring = carry
        k, start, length, a, b, look = row
        late = [_late(lag, states.index(lag.state), ring, x0, at, slots) for lag, at in zip(lags, look, strict=True)]
        fed = _fed(rate, lags, late)
        x1 = step(fed, x, (*a, jnp.zeros_like(start)), (*b, jnp.ones_like(start)), length, p, True)
        before, after = fed(x, (*a, 0.0), p), fed(x1, (*b, 1.0), p)
        piece = jnp.stack([jnp.stack([x[i], length * before[i], x1[i], length * after[i]]) for i in states])
        return (x1, ring.at[k % slots].set(piece)), x1

    ring = jnp.zeros((slots, len(states), 4))
    start = tuple(jnp.asarray(v, dtype=float) for v in x0)
    rows = jnp.arange(count), times[:-1], lengths, tuple(u0), tuple(u1), looks
    _, later = jax.lax.scan(body, (start, ring), rows)
    return tuple(jnp.concatenate([v[None], w]) for v, w in zip(start, later, strict=True))


class _Look(NamedTuple):
    """Where the late values at the start, middle and end of every step are found; arrays (K, 3)."""

    piece: Any  # the past step; -1 before the record
    share: Any  # how far into it, NaN when it cannot be known

    @staticmethod
    def of(times, delay, count, slots) -> "_Look":
        ends = jnp.stack([times[:-1], 0.5 * (times[:-1] + times[1:]), times[1:]], axis=1)
        late = ends - delay
        fixed, now, when = jax.lax.stop_gradient((times, times[:-1, None], late))
        # the start of a step looks at what follows a kink, its end at what precedes
        follows = jnp.searchsorted(fixed, when[:, :1], side="right") - 1
        precedes = jnp.searchsorted(fixed, when[:, 1:], side="left") - 1
        step = jnp.arange(count)[:, None]
        piece = jnp.minimum(jnp.concatenate([follows, precedes], axis=1), step - 1)
        length = jnp.diff(times)[jnp.maximum(piece, 0)]
        share = (late - times[jnp.maximum(piece, 0)]) / jnp.where(length > 0.0, length, 1.0)
        early = when <= fixed[0]
        unknown = (when > now + SLACK * jnp.diff(fixed)[:, None]) | (~early & (step - piece > slots)) | ~(delay > 0.0)
        return _Look(jnp.where(early, -1, piece), jnp.where(unknown, jnp.nan, share))


def _late(lag, column, ring, x0, at, slots):
    """The late state at the start, middle and end of a step."""

    def value(piece, share):
        y0, d0, y1, d1 = ring[piece % slots, column]
        b, c = 3.0 * (y1 - y0) - 2.0 * d0 - d1, 2.0 * (y0 - y1) + d0 + d1
        known = piece >= 0
        s = jnp.where(known, share, 0.0)
        past = jnp.where(known, y0 + s * (d0 + s * (b + s * c)), x0[lag.state])
        return jnp.where(jnp.isnan(share), jnp.nan, past)

    return tuple(value(at.piece[j], at.share[j]) for j in range(3))


def _fed(rate, lags, late):
    """The rate with the late states as a parabola over the step; its last channel runs from 0 to 1."""

    def fed(x, u, p):
        channels, s = list(u[:-1]), u[-1]
        for lag, (a, m, b) in zip(lags, late, strict=True):
            channels[lag.place] = a + s * (4.0 * m - 3.0 * a - b + s * 2.0 * (a - 2.0 * m + b))
        return rate(x, tuple(channels), p)

    return fed
