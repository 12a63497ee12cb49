"""Rests of many plants: by Newton's method from a few inputs, and where that fails from all over their range.

Newton's method fails where an iterate lies in a saturation, as of a current limit, where no slope shows what the
input does, and steep friction throws it there. So it begins again at a grid of inputs, with states that give the
output its level. What it still does not find, the settled output tells: where it passes the level between two
constant inputs, that interval is divided until Newton's method gets from there to the rest.
"""

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from plantfit.control.rests.equations import Equations, solved
from plantfit.runtime import jit
from plantfit.simulate.steady import steady_states
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp

REST = 1e-8  # of the equations, scaled: what may be left of them
WIDER = 0.15  # of the inputs' range, beyond either of its ends
STARTS, FEW = 33, 9  # inputs that Newton's method begins at, of the first plant and of the others
SETTLED, PARTS, TIMES = 129, 33, 3  # inputs that the plant settles at; parts of an interval, divided so many times
BRINGING = 10  # steps that bring the output to the level


def at_level(key: Equations, begin: np.ndarray, level: float, rows: Any) -> np.ndarray:
    """States and input (n, s + 1) of every plant at rest where its output is `level`, from starts (starts, s + 1);
    NaN where none is found. Of several the one with the input nearest to the middle of the starts'."""
    middle = float(np.median(begin[:, -1]))
    found = _nearest(solved(key, begin, float(level), rows), middle)
    lost = np.isnan(found[:, -1])
    if not np.any(lost):
        return found
    if lost[0]:
        found[0] = _first(key, begin, level, tuple(v[:1] for v in rows), middle)
    if np.isnan(found[0, -1]):  # the best fit rests nowhere, so that no loop is tuned and the others do not count
        return found
    if np.any(lost[1:]):
        grid = _grid(begin[:, -1], FEW)
        near = np.c_[np.tile(found[0, :-1], (FEW, 1)), grid]
        more = _nearest(solved(key, np.r_[found[:1], near], float(level), rows), middle)
        found = np.where(np.isnan(found), more, found)
    return found


def settled_range(key: Equations, x: np.ndarray, lower: float, upper: float, row: Any) -> tuple[float, float] | None:
    """The lowest and highest output at which a plant settles from states x (s,) under constant inputs within limits;
    None where it settles under none or not under all of them."""
    y = _settled(key, x, np.linspace(lower, upper, SETTLED), row)[1]
    return (float(np.min(y)), float(np.max(y))) if np.all(np.isfinite(y)) else None


def _nearest(result: Any, middle: float) -> np.ndarray:
    """Of the `result` of `solved` the rests (n, s + 1) nearest to the middle input, else NaN."""
    z, error = (np.asarray(v) for v in result)
    far = np.where(error < REST, np.abs(z[..., -1] - middle), np.inf)
    best, every = np.argmin(far, axis=0), np.arange(z.shape[1])
    return np.where(np.isfinite(far[best, every])[:, None], z[best, every], np.nan)


def _grid(u: np.ndarray, count: int) -> np.ndarray:
    """Inputs (count,) over a range and a little beyond it."""
    low, high = float(np.min(u)), float(np.max(u))
    more = WIDER * (high - low) if high > low else max(abs(high), 1.0)
    return np.linspace(low - more, high + more, count)


def _first(key: Equations, begin: np.ndarray, level: float, row: Any, middle: float) -> np.ndarray:
    """States and input (s + 1,) of one plant at rest, from all over the range of inputs."""
    x, grid = begin[len(begin) // 2, :-1], _grid(begin[:, -1], STARTS)
    plain = np.c_[np.tile(x, (STARTS, 1)), grid]
    brought = np.asarray(_brought(key, plain, float(level), tuple(v[0] for v in row)))
    brought = np.where(np.isfinite(brought), brought, plain)
    found = _nearest(solved(key, np.r_[plain, brought], float(level), row), middle)[0]
    if np.isfinite(found[-1]):
        return found
    ends = _crossings(key, x, level, _grid(begin[:, -1], SETTLED), row, middle)
    return _nearest(solved(key, ends, float(level), row), middle)[0] if len(ends) else found


@partial(jit, static_argnums=0)
def _brought(key: Equations, begin: Any, level: Any, p: Any) -> Any:
    """Starts (starts, s + 1) with states moved as little as gives the output the level."""
    n, kept = len(key.vector.states), np.isin(np.arange(len(key.vector.states)), key.kept)

    def one(z):
        u = jnp.full(len(key.ways), z[n])

        def step(x, _):
            y, slope = jax.value_and_grad(key.out)(x, u, p)
            slope = jnp.where(kept, slope, 0.0)
            return x + slope * (level - y) / jnp.maximum(slope @ slope, 1e-300), None

        return jnp.append(jax.lax.scan(step, z[:n], None, length=BRINGING)[0], z[n])

    return jax.vmap(one)(begin)


def _crossings(key: Equations, x: np.ndarray, level: float, u: np.ndarray, row: Any, middle: float) -> np.ndarray:
    """States and inputs (starts, s + 1) beside the place nearest to the middle where the settled output passes the
    level, closer and closer; (0, s + 1) where it passes it nowhere."""
    found = []
    for _ in range(1 + TIMES):
        states, y = _settled(key, x, u, row)
        passed = np.flatnonzero((y[:-1] - level) * (y[1:] - level) <= 0)  # false where one is not a number
        if not len(passed):
            break
        k = passed[np.argmin(np.abs(u[passed] - middle))]
        found.append(np.c_[states[k : k + 2], u[k : k + 2]])
        x, u = states[k], np.linspace(u[k], u[k + 1], PARTS)
    return np.concatenate(found) if found else np.zeros((0, len(x) + 1))


def _settled(key: Equations, x: np.ndarray, u: np.ndarray, row: Any) -> tuple[np.ndarray, np.ndarray]:
    """States (N, s) of one plant settled from x (s,) under constant inputs u (N,), and its output (N,); NaN where it
    does not settle."""
    if key.vector.rate_uses_time:
        return np.full((len(u), len(x)), np.nan), np.full(len(u), np.nan)
    channels = tuple(np.broadcast_to(np.asarray(c, dtype=float), u.shape) for c in key.channels([u] * len(key.ways)))
    p = tuple(v[0] for v in row)
    found = steady_states(_of_kept(key), channels, p, tuple(float(v) for v in x))
    y = np.asarray(key.vector.output(found, channels, p)[key.output])
    return np.stack([np.asarray(v) for v in found], axis=1), np.broadcast_to(y, u.shape)


@lru_cache(maxsize=32)  # one identity, so that it is compiled once
def _of_kept(key: Equations) -> VectorModel:
    """The model with the states that reach no output settled at 0, as they may have no rest."""

    def rate(x: Any, u: Any, p: Any) -> Any:
        return tuple(r if i in key.kept else -x[i] for i, r in enumerate(key.vector.rate(x, u, p)))

    return replace(key.vector, rate=rate)
