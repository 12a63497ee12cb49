"""Costs of many candidates side by side, and their gradients, in one compiled loop over chunks of steps.

Candidates stay the last axis all the way through the loop, as the machine code has them, so that nothing is transposed on the way.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.simulate.intervals import Row, kept_sums, pulled_back
from plantfit.simulate.schedule import Chunks
from plantfit.simulate.simulator import Simulator

import jax
import jax.numpy as jnp


def squares_side_by_side(simulator: Simulator, windows: str, p: Any, x0: Any, chunks: Chunks, weight: Any = None) -> tuple[Any, ...]:
    """Sum of squared residuals of every output, a tuple of (n,), for n candidates; it can be differentiated backwards by p and x0.

    `chunks` are `rows_first`, `windows` and `weight` (L,) as `Batch` has them; leaves of `p` are (..., L, n) in the order of the
    simulator's parameters, those of `x0` (L, n). Needs `Batch.few_edges`.
    """

    @jax.custom_vjp
    def totals(p, x0):
        return _forwards(simulator, windows, p, x0, chunks, weight, keep=False)[0]

    def forwards(p, x0):
        found, before = _forwards(simulator, windows, p, x0, chunks, weight, keep=True)
        return found, (p, x0, before)

    def backwards(saved, cotangents):
        p, x0, before = saved
        return _backwards(simulator, windows, p, x0, before, cotangents, chunks, weight)

    totals.defvjp(forwards, backwards)
    return totals(p, x0)


def _forwards(simulator: Simulator, windows: str, p: Any, x0: Any, chunks: Chunks, weight: Any, *, keep: bool) -> tuple[Any, Any]:
    """Totals; with `keep` the states before every interval, a tuple of (M, R, C, n)."""

    def body(carry, chunk: Chunks):
        x, totals = carry
        rows = _of_rows(p, chunk)
        x = tuple(jnp.where(chunk.first[:, None], a.at[chunk.lane].get(mode="promise_in_bounds"), b) for a, b in zip(x0, x, strict=True))

        def run_rows(late):
            run = partial(_kept, kept_sums(simulator, late), keep)
            over_candidates = jax.vmap(run, in_axes=(-1, -1, None, None), out_axes=-1)
            return jax.vmap(over_candidates, in_axes=(-2, 0, 0, 0))(rows, x, _row(chunk), chunk.knots)

        (x, more), before = _chosen(windows, chunk, run_rows)
        if weight is not None:
            more = tuple(m * _counted(weight, chunk) for m in more)
        return (x, tuple(a + jnp.sum(b, axis=0) for a, b in zip(totals, more, strict=True))), before

    n = x0[0].shape[-1]
    begin = tuple(jnp.zeros((chunks.lane.shape[1], n)) for _ in x0), tuple(jnp.zeros(n) for _ in chunks.measured)
    (_, totals), before = jax.lax.scan(body, begin, chunks)
    return totals, before


def _kept(run: Callable, keep: bool, p: Any, x: Any, row: Row, around: Any) -> tuple[Any, Any]:
    ended, before = run(p, x, row, around, keep)
    return ended, before if keep else ()


def _backwards(simulator: Simulator, windows: str, p: Any, x0: Any, before: Any, cotangents: Any, chunks: Chunks, weight: Any) -> Any:
    """Derivatives by p and x0. The gradient of a row is carried along it, and added to its record's where the record begins."""

    def body(carry, step):
        adjoint, own, found = carry
        chunk, states = step
        rows = _of_rows(p, chunk)
        weights = tuple(jnp.broadcast_to(c, adjoint[0].shape) for c in cotangents)
        if weight is not None:
            weights = tuple(w * _counted(weight, chunk) for w in weights)

        def run_rows(late):
            over_candidates = jax.vmap(pulled_back(simulator, late), in_axes=(-1, -1, None, None, -1, -1, -1), out_axes=-1)
            over = jax.vmap(over_candidates, in_axes=(-2, 0, 0, 0, 0, 0, -2), out_axes=(-2, 0))
            return over(rows, states, _row(chunk), chunk.knots, adjoint, weights, own)

        own, adjoint = _chosen(windows, chunk, run_rows)
        return jax.lax.cond(jnp.any(chunk.first), partial(_begun, chunk), lambda *same: same, adjoint, own, found), None

    n, count = x0[0].shape[-1], chunks.lane.shape[1]
    nothing = tuple(jnp.zeros((count, n)) for _ in x0)
    own = jax.tree.map(lambda a: jnp.zeros((*a.shape[:-2], count, n)), p)
    (_, _, found), _ = jax.lax.scan(body, (nothing, own, jax.tree.map(jnp.zeros_like, (p, x0))), (chunks, before), reverse=True)
    return found


def _begun(chunk: Chunks, adjoint: Any, own: Any, found: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    """Where records begin in the rows: what was gathered belongs to them."""
    first = chunk.first[:, None]
    by_p = jax.tree.map(lambda all_, a: all_.at[..., chunk.lane, :].add(jnp.where(first, a, 0.0)), found[0], own)
    by_start = tuple(all_.at[chunk.lane].add(jnp.where(first, a, 0.0)) for all_, a in zip(found[1], adjoint, strict=True))
    empty = partial(jax.tree.map, lambda a: jnp.where(first, 0.0, a))
    return empty(adjoint), empty(own), (by_p, by_start)


def _of_rows(p: Any, chunk: Chunks) -> Any:
    return jax.tree.map(lambda a: a.at[..., chunk.lane, :].get(mode="promise_in_bounds"), p)


def _row(chunk: Chunks) -> Row:
    return Row(chunk.t[:, :-1], chunk.t[:, 1:], chunk.start, chunk.slope, chunk.at, chunk.measured, chunk.scored)


def _counted(weight: Any, chunk: Chunks) -> Any:
    return weight.at[chunk.lane].get(mode="promise_in_bounds")[:, None]


def _chosen(windows: str, chunk: Chunks, run_rows: Callable[[bool], Any]) -> Any:
    if windows == "some":
        return jax.lax.cond(chunk.window, lambda: run_rows(True), lambda: run_rows(False))
    return run_rows(windows == "all")
